"""What a twin with its effects predicts of an update of a run, and how far the update is from
it.
"""
