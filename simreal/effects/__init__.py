"""The catalogue of candidate effects (effects.md section 2), one class each; start with `base`,
then `catalogue`.
"""
