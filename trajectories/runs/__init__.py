"""Run directories: streams read and written strictly, long logs left in their file, checks of every
row.
"""
