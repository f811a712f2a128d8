"""Rows and clocks of foreign logs: column maps, increments, damaged rows, wrapped clocks, GPS
time.
"""
