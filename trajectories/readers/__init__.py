"""Readers of flight logs: each turns one format into a `ConvertedLog`.

Contract: a reader knows whether a file is of its format (`detect`, by content) and reads it with
the options of a map file (`read`); it drops what it must, lists what it dropped, and raises
InputError for the rest. Reading order: registry (what a reader is), columns (units, axes, times),
fixes (GPS), delimited and binary (rows of numbers), dataflash and ulog_file (messages that describe
themselves), ardupilot and px4 (what they mean).
"""
