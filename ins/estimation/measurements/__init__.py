"""What may be measured of a solution's errors: residual, rows and noise, from arrays."""
