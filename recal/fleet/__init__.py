"""Many runs of many units: `recal fleet update`. Read `update` (the spine) first, then `work` (what
a worker does).

Runs of a unit go one after the other, units side by side; results come back to one parent, which
alone keeps the journal.
"""
