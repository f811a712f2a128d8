"""What effects are built of: formulas on telemetry, gyro effects, needs, hysteresis, thermal
memory, recordings.
"""
