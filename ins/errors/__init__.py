"""The one list of errors: of the unit, its mount, its receiver and its table (effects.md, 2).

Inside: `base` (what an error is) and `telemetry` (what it sees of a run, and its trace), `prior`
(what estimators assume), then a module for each family, `catalogue`, which joins them with those of
installed packages, and `reference`, which prints them. A user's own error is written with the names
of `simreal.effects.own`; examples/own_effect.py is one.
"""
