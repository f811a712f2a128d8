"""The catalogue of candidate effects (gap.md section 2), one class each; start with `base`, then
`catalogue`.
"""
