"""Makes and reads data: truth as functions of time, ideal and imperfect sensors, run directories, logs.

The only source of truth in the project; estimators (`alignment`, `infield`) never import it.
Of `ins` it uses units, records, earth constants with gravity, and rotations, nothing else.
Reading order: motions, truth, sensors, thermal, imperfections, scenario, run, readers.
"""
