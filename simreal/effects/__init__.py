"""The catalogue of candidate effects (effects.md section 2), one class each.

A user's own effect is written with the names of `own`; examples/own_effect.py is one. Inside:
`base` (what an effect is) and `telemetry` (what it sees of a run, and its trace), then a module for
each family, then `catalogue`, which joins them with those of installed packages; `words` says in
plain sentences what each is.
"""
