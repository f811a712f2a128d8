"""Strapdown mechanization (`mechanization`, `loop`) by the formulas of `kernel`."""
