"""Strapdown inertial navigation on arrays: physics, mechanization, error model, filter.

Imports nothing else of this project. Inside: SI units and radians; body axes forward-right-down,
navigation axes north-east-down; error = computed - true, bias = measured - true.
Reading order: units, records, earth, attitude, increments, mechanization, error_model, kalman.
"""
