"""Hypothesis: the same cases on every run, and no deadline (the first call compiles; the machine
may be shared).
"""

from hypothesis import settings

settings.register_profile("suite", deadline=None, derandomize=True)
settings.load_profile("suite")
