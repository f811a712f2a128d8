"""What the errors of sensors and of gravity make the inputs of the core wrong by, step by step.

Each function lets some states of a tape drive its steps (`Tape.drive`). The states are given by
their places, so that a recipe lays them out as it likes; where it has none, nothing drives. In body
axes, with omega the rate and f the specific force, both means over a step::

    gyro           bias + shift + scale omega + misalignment omega + sensitivity (f - REST_B)
    accelerometer  bias + shift + scale f + slope (T - mean of T)
    gravity        g deflection, north and east

Shifts are what a sensor reads in flight beyond what it reads at rest. Sources: Groves (2013),
sections 4.4.1 to 4.4.3; signs: CONVENTIONS.md.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.estimation.states import ACCEL, BASE, SCALE_Z
from ins.estimation.tape import ACCELERATION, ACCELEROMETER, GYRO, Tape
from ins.units import STANDARD_GRAVITY

MISALIGNED = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))  # gyro, axis whose rate it reads
REST_B = np.array([0.0, 0.0, -STANDARD_GRAVITY])  # specific force of a level rest [m/s^2]


def usual(tape: Tape) -> None:
    """The usual errors of a unit whose height is given, at their places among the base states.

    They are its gyros' biases in the bin of each step, its level accelerometers' biases and the
    scale of its vertical gyro.

    Parameters
    ----------
    tape : Tape
    """
    steps = tape.steps
    bin_biases(tape, BASE)
    accelerometer_biases(tape, range(ACCEL.start, ACCEL.stop))
    tape.drive(SCALE_Z, GYRO + 2, steps.turn_rad / steps.dt_s)


def bin_biases(tape: Tape, first: int) -> None:
    """Biases of the gyros, each step's by its bin.

    Parameters
    ----------
    tape : Tape
    first : int
        The state of gyro x in bin 0; three states a bin follow one another.
    """
    of_bin = first + 3 * np.asarray(tape.steps.bin_index, dtype=np.int64)
    for axis in range(3):
        tape.drive(of_bin + axis, GYRO + axis, 1.0)


def gyro_scales(tape: Tape, states: Sequence[int], rate_b: NDArray) -> None:
    """Scale errors of gyros x, y, z.

    Parameters
    ----------
    tape : Tape
    states : sequence of int
        At most three, in the order of the axes.
    rate_b : ndarray, shape (K, 3)
        In rad/s.
    """
    _own_axis(tape, states, GYRO, rate_b)


def misalignments(tape: Tape, states: Sequence[int], rate_b: NDArray) -> None:
    """Misalignments of the gyros, in the order of `MISALIGNED`.

    Parameters
    ----------
    tape : Tape
    states : sequence of int
        Six or none [rad].
    rate_b : ndarray, shape (K, 3)
        In rad/s.
    """
    for (gyro, axis), state in zip(MISALIGNED, states):
        tape.drive(state, GYRO + gyro, rate_b[:, axis])


def force_sensitivities(tape: Tape, states: Sequence[int], force_b: NDArray) -> None:
    """What gyros x, y, z read by the specific force along them, less that of a level rest.

    Parameters
    ----------
    tape : Tape
    states : sequence of int
        Three or none [rad/s per m/s^2].
    force_b : ndarray, shape (K, 3)
        In m/s^2.
    """
    _own_axis(tape, states, GYRO, force_b - REST_B)


def gyro_shifts(tape: Tape, states: Sequence[int], flying: NDArray) -> None:
    """What gyros x, y, z read in flight beyond what they read at rest.

    Parameters
    ----------
    tape : Tape
    states : sequence of int
        Three or none [rad/s].
    flying : ndarray of bool, shape (K,)
    """
    _own_axis(tape, states, GYRO, flying[:, None])


def accelerometer_biases(tape: Tape, states: Sequence[int], *, first_axis: int = 0) -> None:
    """Biases of the accelerometers.

    Parameters
    ----------
    tape : Tape
    states : sequence of int
        In the order of the axes [m/s^2].
    first_axis : int
        Axis of the first of them.
    """
    _own_axis(tape, states, ACCELEROMETER + first_axis, 1.0)


def accelerometer_scales(tape: Tape, states: Sequence[int], force_b: NDArray) -> None:
    """Scale errors of accelerometers x, y, z.

    Parameters
    ----------
    tape : Tape
    states : sequence of int
        Three or none.
    force_b : ndarray, shape (K, 3)
        In m/s^2.
    """
    _own_axis(tape, states, ACCELEROMETER, force_b)


def accelerometer_shifts(tape: Tape, states: Sequence[int], flying: NDArray) -> None:
    """What accelerometers x, y, z read in flight beyond what they read at rest.

    Parameters
    ----------
    tape : Tape
    states : sequence of int
        Three or none [m/s^2].
    flying : ndarray of bool, shape (K,)
    """
    _own_axis(tape, states, ACCELEROMETER, flying[:, None])


def accelerometer_slopes(tape: Tape, states: Sequence[int], above_degC: NDArray) -> None:
    """Changes of the biases of accelerometers x, y, z with temperature.

    Parameters
    ----------
    tape : Tape
    states : sequence of int
        Three or none [m/s^2 per degC].
    above_degC : ndarray, shape (K,)
        Temperature less the one at which the biases are meant.
    """
    _own_axis(tape, states, ACCELEROMETER, above_degC[:, None])


def deflections(tape: Tape, states: Sequence[int]) -> None:
    """Deflection of the vertical: gravity that points off the normal gravity, north and east.

    Parameters
    ----------
    tape : Tape
    states : sequence of int
        Two or none [rad].
    """
    _own_axis(tape, states, ACCELERATION, np.asarray(tape.steps.gravity)[:, None])


def _own_axis(tape: Tape, states: Sequence[int], first: int, value: ArrayLike) -> None:
    """Each state drives the input of its own axis, from `first` on; value (), (K, 1) or (K, 3):
    per unit of the state.
    """
    values = np.broadcast_to(np.asarray(value, dtype=float), (len(tape.steps.dt_s), 3))
    for axis, state in enumerate(states):
        tape.drive(state, first + axis, values[:, axis])
