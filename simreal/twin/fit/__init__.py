"""The noise of a unit from its own parked logs: `streams` (when it rests), `spectra` and `slow`
(what it does then), `terms` (what that may be made of), `model` (the likelihood), `evidence` (what
can be told), `fit` (the spine), `result`.
"""
