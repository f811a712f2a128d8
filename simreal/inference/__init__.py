"""Which effects explain the gap: bank of hypotheses, scoring, attribution, shrink on held-out
data.
"""
