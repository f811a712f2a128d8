"""What a parked vehicle goes through: wind, people, fuel, cargo, machines, a ship's motion.

Each environment is a function of time made of loads (newtons and newton metres on the gear) or of
motions (a ship). `gear` turns loads into sway, tilt and yaw, `laying` puts these into the truth:
position, velocity, attitude and both sensors from one motion.

Reading order: `kinds` (names, strengths), `scene` (the times when the vehicle is parked), `spectra`
(published spectra), `wind`, `people`, `cargo`, `machines`, `ship` (one environment each or a few),
`gear`, `catalogue` (which is which), `laying`.

No estimator knows any of this. What each number comes from is in docs/environments.md.
"""
