"""The verbs of a twin: fit it to runs, hold it against runs, take it from and to other programs."""
