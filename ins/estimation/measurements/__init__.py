"""What may be measured of a solution's errors: residual and rows, from arrays."""
