"""Seeded blind trials for the diagnosis of the sim-to-real gap: runs with a planted effect, and the
same runs without.

Nothing here reads or imports `simreal`: the effects are written from physics, a little richer than
any catalogue. Read `trial` (draw_trial), then `runs` (plans, the base simulation), `effects` (what
can be planted), `outside` (pyins).

Decision: docs/decisions/0014-independent-bound.md.
"""
