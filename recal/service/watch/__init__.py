"""`recal watch`: `session` (the verb), `recording` (rows to run directories), `monitor` (seconds,
phase, faults), `worker` (a process that estimates), `interim` (estimates, predictions, advice),
`part_rows` (their rows), `reasons` (what is waited for), `records` (what is said), `feed` (a run
sent as MAVLink).
"""
