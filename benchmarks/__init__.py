"""Studies and timings that stand beside the program: they see truth and estimator both, and are not
installed.
"""
