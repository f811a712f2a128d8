"""Makes and reads data: truth as functions of time, ideal and imperfect sensors, run directories,
logs.

The only source of truth in the project; estimators (`alignment`, `infield`) never import it.
The simulator takes from `ins` units, records, file formats, earth constants with gravity,
rotations, nothing else. Reading order: `simulator` (motions, truth, sensors, vehicle, thermal,
unit_truth, imperfections, session, scenario), `runs`, `readers`.
"""
