"""The twin of a unit: effects put into a simulated run (`inject`, `inject_truth`, their noise in
`added_noise`), and the twin file with what a diagnosis found (`write_back`).
"""
