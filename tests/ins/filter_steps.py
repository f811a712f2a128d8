"""One step or one row at a time for a filter that takes whole tapes."""

import numpy as np

from ins import earth
from ins.estimation import error_model as em
from ins.estimation import sensors
from ins.estimation.tape import Steps, Tape
from ins.units import DEG

LAT = 45 * DEG
STANDING = {"rolling": False, "keep": False, "moving": False, "jump_w": 0.0, "jump_theta": 0.0}


def steps_of(
    step: em.Step, count=1, *, bin_index=0, extra_yaw_rad=0.0, end_s=0.0, **flags
) -> Steps:
    """The same step `count` times, at latitude 45 deg and height 0; flags and jumps as of Steps."""
    flags = {**STANDING, **flags}
    meridian, transverse = (float(r) for r in earth.radii_of_curvature(LAT))

    def all_of(value):
        return np.broadcast_to(value, (count, *np.shape(value)))

    return Steps(
        end_s=end_s + step.dt_s * np.arange(count),
        dt_s=all_of(step.dt_s),
        C_nb=all_of(step.C_nb),
        v_n=all_of(step.v_n),
        omega_ie_n=all_of(step.omega_ie_n),
        transport=all_of(np.array([1.0 / transverse, 1.0 / meridian, np.tan(LAT) / transverse])),
        gravity=all_of(step.gravity),
        radius_m=all_of(step.radius_m),
        turn_rad=all_of(step.turn_rad),
        bin_index=all_of(bin_index),
        jump_yaw=all_of(extra_yaw_rad**2),
        **{name: all_of(value) for name, value in flags.items()},
    )


def advance(flt, step, bin_index=0, **flags):
    """One step, nothing measured."""
    flt.run(driven(steps_of(step, bin_index=bin_index, **flags)))


def driven(steps):
    """A tape over steps that the usual sensors' errors drive."""
    tape = Tape(steps)
    sensors.usual(tape)
    return tape


def only(time_s=0.0):
    """A tape that stands still, to hang operations on: one step of no length."""
    C_nb, none = np.eye(3), np.zeros(3)
    step = em.Step(
        dt_s=1e-12,
        C_nb=C_nb,
        v_n=none,
        omega_ie_n=none,
        omega_en_n=none,
        gravity=0.0,
        radius_m=1e30,
        turn_rad=0.0,
    )
    return driven(steps_of(step, keep=True, rolling=True, end_s=time_s))


def measure(flt, name, z, rows, variance, time_s=0.0, *, gate=np.inf):
    """One measurement at once; returns whether it was used."""
    tape = only(time_s)
    tape.measure(name, np.array([0]), np.atleast_1d(z), rows, np.atleast_1d(variance), gate=gate)
    before = len(flt.tally.rejected)
    flt.run(tape)
    return len(flt.tally.rejected) == before


def dense(row, size, at=0):
    """A sparse row as a vector."""
    H = np.zeros(size)
    for index, value in row.items():
        H[index] = np.broadcast_to(value, (max(np.size(value), 1),))[at]
    return H
