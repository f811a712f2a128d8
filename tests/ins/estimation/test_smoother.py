"""The smoother against clones: a state that was copied at a step stands, so that the filter's last
posterior of the copy is what all measurements say of the step.
"""

import numpy as np
import pytest

from ins.estimation import sensors
from ins.estimation.error_filter import ErrorFilter
from ins.estimation.states import BASE, POS, THETA, W
from ins.estimation.tape import LEAPT, RENEW, RENEWED, Tape
from tests.ins.estimation.test_response import NOISE, joined

CORE = np.arange(THETA.stop)
SLOW = range(BASE + 3, BASE + 6)  # a slow error of the positions, then the copies of CORE
COPY = np.arange(SLOW.stop, SLOW.stop + CORE.size)
FADES, AFTER_S = 0.9, 12.0


def swept(at: int, *, copied: bool, smooth: bool, moved=(0.0, 0.0)):
    """An S with fixes at every third step. moved: positions [m] and velocities [m/s] of the last
    third are off by as much, which a filter that is begun anew after AFTER_S follows.
    """
    steps = joined()
    count, rng = len(steps.end_s), np.random.default_rng(7)
    tape = Tape(steps)
    sensors.bin_biases(tape, BASE)
    every = np.arange(count)
    for state in SLOW:
        tape.assign(every, state, {state: FADES}, 1.0 - FADES**2)
    fixes = every[2::3]
    off = (fixes > 2 * count // 3)[:, None] * np.array(moved)
    rows = [{POS.start + k: 1.0, THETA.start + k: 3.0, SLOW[k]: -1.0} for k in range(2)]
    z = rng.standard_normal((2, fixes.size)) + off[:, 0]
    tape.measure(
        "position", fixes, [*z, 0.0 * z[0]], [*rows, {SLOW[2]: 1.0}], [1.0, 1.0, 1.0], gate=5.0
    )
    z = 0.1 * rng.standard_normal((2, fixes.size)) + off[:, 1]
    rows = [{W.start + k: 1.0, THETA.start + 2: 4.0} for k in range(2)]
    tape.measure("velocity", fixes, z, rows, [0.01, 0.01], gate=5.0)
    tape.renew(fixes, SLOW, 2, AFTER_S)
    if copied:
        for state, copy in zip(CORE, COPY):
            tape.assign(np.array([at]), int(copy), {int(state): 1.0}, 0.0)
    tape.record(np.array([at]))
    flt = ErrorFilter(
        sigma0={"W": 0.05, "POS": 3.0, "THETA": 1e-3},
        noise=NOISE,
        bias_mean=np.zeros(3),
        bias_covariance=np.diag([3e-8**2] * 3),
        further_sigma=(1.0,) * 3 + (0.0,) * CORE.size,
        further_walks=dict.fromkeys(range(BASE, BASE + 3), 1e-18),
    )
    found, x, P = flt.run_for_records(tape, CORE, smooth=smooth)
    return flt, x[0], P[0], found.outcome[found.tape.ops[:, 0] == RENEW]


@pytest.mark.parametrize("at", [5, 20, 44])
@pytest.mark.parametrize(
    ("moved", "became"), [((0.0, 0.0), None), ((80.0, 0.0), LEAPT), ((80.0, 30.0), RENEWED)]
)
def test_what_all_measurements_say_is_the_last_posterior_of_a_copy(at, moved, became):
    copied, *_ = swept(at, copied=True, smooth=False, moved=moved)
    _, x, P, outcome = swept(at, copied=False, smooth=True, moved=moved)
    assert became is None or (outcome == became).any()
    scale = np.sqrt(np.diag(copied.P)[COPY])
    held = np.flatnonzero(scale > 0.0)
    wanted = copied.P[np.ix_(COPY, COPY)]
    np.testing.assert_allclose(
        (x - copied.x[COPY])[held] / scale[held], np.zeros(held.size), atol=1e-6
    )
    over = np.outer(scale, scale)[np.ix_(held, held)]
    np.testing.assert_allclose((P - wanted)[np.ix_(held, held)] / over, 0.0 * over, atol=1e-6)
    assert not np.allclose(x, swept(at, copied=False, smooth=False, moved=moved)[1])


def test_considered_states_widen_and_stay():
    """Of a slow error that is considered: its mean and variance stay as they are, and what is
    estimated beside it is no better known than where it is estimated.
    """
    tape = Tape(joined())
    fixes = np.arange(3, len(tape.steps.end_s), 3)
    tape.measure("position", fixes, [1.0], [{POS.start: 1.0, SLOW[0]: -1.0}], [1.0])

    def run(considered: bool):
        flt = ErrorFilter(
            sigma0={"W": 0.05, "POS": 3.0, "THETA": 1e-3},
            noise=NOISE,
            bias_mean=np.zeros(3),
            bias_covariance=np.zeros((3, 3)),
            further_sigma=(2.0,) * 3,
        )
        flt.considered_from = SLOW[0] if considered else flt.considered_from
        flt.run(tape)
        return flt

    estimated, considered = run(False), run(True)
    assert considered.P[SLOW[0], SLOW[0]] == pytest.approx(4.0) and considered.x[SLOW[0]] == 0.0
    assert considered.P[POS.start, POS.start] > estimated.P[POS.start, POS.start] * (1.0 - 1e-9)
    assert considered.P[POS.start, POS.start] > 4.0 - 1e-6
