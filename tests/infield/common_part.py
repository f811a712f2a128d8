"""What an update does to the common part of an axis."""


def common_shift(table, axis, updated):
    """How far it moved [deg/h]."""
    return float(table.common_weights(axis) @ (updated.parameters - table.parameters))
