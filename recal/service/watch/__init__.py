"""`recal watch`: `session` (the verb), `recording` (rows to run directories), `monitor` (seconds,
phase, faults), `interim` (estimates and predictions, in a process of its own), `advice` (what to
do), `records` (what is said), `feed` (a run sent as MAVLink).
"""
