"""Units that change within a log, logs that stand still, many lost increments: seen, and nothing
where there is nothing.
"""

import numpy as np
import pytest

from ins.records import InputError
from tests.trajectories.readers.hostile_rows import convert, noisy
from tests.trajectories.readers.known_motion import GIVEN, at_rest
from tests.trajectories.readers.test_maps import N
from trajectories.readers import conversion_checks
from trajectories.readers.conversion_checks import _Blocks

GYROS, FORCES = ("wx", "wy", "wz"), ("fx", "fy", "fz")
CHANGES = [
    (GYROS, np.pi / 180, "deg/s to rad/s"),
    (GYROS, 180 / np.pi, "rad/s to deg/s"),
    (GYROS, np.pi / 648_000, "deg/h to rad/s"),
    (FORCES, 9.80665, "g to m/s2"),
    (FORCES, 1 / 9.80665, "m/s2 to g"),
    (FORCES, 9.80665e-3, "mg to m/s2"),
]


@pytest.mark.parametrize("technology", ["rlg", "mems"])
@pytest.mark.parametrize("row", [400, 3000, 5600])
@pytest.mark.parametrize(("names", "factor", "told"), CHANGES)
def test_a_unit_that_changes_within_the_log(tmp_path, names, factor, told, row, technology):
    """As after an update in flight: refused with the place, and either side of it can be taken."""
    columns = noisy()
    for name in names:
        columns[name][row:] *= factor
    given = GIVEN | {"gyro_technology": technology}
    with pytest.raises(InputError, match=rf"{told} within the log\?") as refusal:
        convert(tmp_path, columns, given=given)
    text = str(refusal.value)
    first, last = (
        int(word) for word in text.partition("rows ")[2].partition(":")[0].split(" and ")
    )
    to_s, from_s = (float(text.partition(key)[2].split()[0]) for key in ("--to-s", "--from-s"))
    assert first <= row + 1 <= last and to_s < columns["t"][row] < from_s and from_s - to_s < 2.1
    if row == 3000:
        assert convert(tmp_path, columns, {"to_s": to_s}, given).run.imu.rows > 2700


@pytest.mark.parametrize("gain", [5.0, 57.3, 300.0])
def test_engines_are_no_change_of_unit(tmp_path, gain):
    """Both shake more from a moment on; or the gyros alone, by a factor between no two units."""
    rng, columns = np.random.default_rng(4), noisy()
    for name in (*GYROS, *FORCES):
        columns[name][3000:] += (
            gain * rng.standard_normal(N - 3000) * (0.5 if name in GYROS else 0.05)
        )
    assert convert(tmp_path, columns).run.imu.rows == N
    columns = noisy()
    for name in GYROS:
        columns[name][3000:] += 20.0 * rng.standard_normal(N - 3000)
    assert convert(tmp_path, columns).run.imu.rows == N


@pytest.mark.parametrize(("a", "b"), [(2000, 2500), (2000, N), (0, 300)])
def test_a_log_that_stands_still_is_said(tmp_path, a, b):
    columns = noisy()
    for name in (*GYROS, *FORCES):
        columns[name][a:b] = columns[name][a]
    lines = [f.text for f in convert(tmp_path, columns).findings]
    span = f"{0.01 * (a + 1):.1f} to {0.01 * b:.1f} s"
    assert lines == [f"log.csv: all six values stand still from {span}: a logger that hangs?"]


def test_a_long_log_is_looked_at_in_pieces(tmp_path, monkeypatch):
    """The same blocks however it is cut."""
    imu = convert(tmp_path, noisy()).run.imu
    whole = _Blocks(imu)
    monkeypatch.setattr(conversion_checks, "PIECE_ROWS", 730)
    cut = _Blocks(imu)
    for name in ("size_f", "noise_w", "noise_f", "same"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name))


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_lost_increments_beside_each_other(tmp_path, share):
    """Rows that hold one interval stand at holes on both sides: each hole has the rate of the row
    after it, gravity stays.
    """
    w, f = at_rest()
    columns = noisy()
    for k in range(3):
        columns[GYROS[k]], columns[FORCES[k]] = np.full(N, w[k] * 0.01), np.full(N, f[k] * 0.01)
    keep = np.sort(np.random.default_rng(3).choice(N, size=round((1 - share) * N), replace=False))
    keys = {
        "gyro": {"columns": list(GYROS), "unit": "rad"},
        "accel": {"columns": list(FORCES), "unit": "m/s"},
    }
    run = convert(tmp_path, {k: v[keep] for k, v in columns.items()}, keys).run
    assert run.imu.rows == keep.size
    off = run.imu.dv_m_s / run.imu.dt_s[:, None] / f - 1
    assert np.abs(off[:-1]).max() < 1e-6
