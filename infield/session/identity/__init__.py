"""Which unit a log is of: what identifies one, against its own history.

Read `marks`, then `history`.
"""
