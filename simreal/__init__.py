"""The sim-to-real gap: where simulator and log disagree, and which effect causes it (not built
yet).
"""
