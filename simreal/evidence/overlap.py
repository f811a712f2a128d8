"""Streams that have nothing to say about a run, since their times lie outside its inertial log, are
left out.
"""

from dataclasses import replace

import numpy as np

from ins.records import Run

# chosen: a minute, the shortest log that is looked at (SHORTEST_REST_S of evidence.seconds, 60)
LEAST_S = 60.0
AIDING_STREAMS = ("temperature", "gnss", "odometer")


def overlapping(run: Run) -> tuple[Run, tuple[str, ...]]:
    """The run without streams that overlap its IMU for less than a minute, and what was left out,
    in words.
    """
    start, end = float(run.imu.start_s), float(run.imu.end_s)
    gone = set()
    notes = []
    for name in AIDING_STREAMS:
        stream = getattr(run, name)
        if stream is None:
            continue
        inside = stream.time_s[(stream.time_s > start) & (stream.time_s <= end)]
        if inside.size < 2 or float(np.ptp(inside)) < min(LEAST_S, 0.5 * (end - start)):
            gone.add(name)
            first, last = (
                float(f(stream.time_s)) if stream.time_s.size else float("nan")
                for f in (np.min, np.max)
            )
            said = f"{name} covers {first:.0f} to {last:.0f} s, the IMU {start:.0f} to {end:.0f} s"
            notes.append(f"run {run.header.run_id}: {said}: left out")
    if not gone:
        return run, ()
    left = replace(
        run,
        temperature=None if "temperature" in gone else run.temperature,
        gnss=None if "gnss" in gone else run.gnss,
        odometer=None if "odometer" in gone else run.odometer,
    )
    return left, tuple(notes)
