"""The simulator for a recorded or simulated run: its motion, effects put in, replicates, the twin
written back.
"""
