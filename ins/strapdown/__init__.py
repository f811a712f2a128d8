"""Strapdown mechanization: one trajectory (`mechanization`, `loop`) and many at once (`batch`), by
the same formulas (`kernel`).
"""
