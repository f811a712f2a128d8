"""A parked unit with noise, so that no row is like another, and what it takes to write it as a CSV
log and convert it.
"""

from pathlib import Path

import numpy as np

from tests.trajectories.readers.known_motion import GIVEN
from tests.trajectories.readers.test_maps import FIXES, GNSS, MAP, N, csv_text, rate_table
from trajectories.readers.conversion import Conversion, convert_log

DATELESS = {k: v for k, v in GIVEN.items() if k != "start_utc"}
PLACELESS = {k: v for k, v in GIVEN.items() if not k.endswith(("_deg", "_m"))}
UNIX_S = 1_772_341_200.0  # 2026-03-01T05:00:00Z by `date -d`
GPS_LESS_UNIX_S = -315_964_800.0 + 18.0  # the epoch of GPS by `date -d`, and 18 leap seconds
SECONDS = np.arange(60.0)
STEPS = 0.01 * np.arange(N)


def noisy() -> dict[str, np.ndarray]:
    """Columns t, wx to wz [deg/h], fx to fz [mg]."""
    rng = np.random.default_rng(1)
    return {
        k: v + (k != "t") * rng.standard_normal(N) * (0.5 if k[0] == "w" else 0.05)
        for k, v in rate_table().items()
    }


def convert(
    path: Path, columns: dict, keys: dict | None = None, given: dict | None = None
) -> Conversion:
    """The columns as log.csv, converted by the map of `noisy` with more keys."""
    (path / "log.csv").write_text(csv_text(columns))
    return convert_log(path / "log.csv", MAP | (keys or {}), GIVEN if given is None else given)


def with_fixes(
    path: Path, *, given: dict | None = None, gnss: dict | None = None, **changes
) -> Conversion:
    """The unit with fixes in gps.csv once a second, some columns changed."""
    (path / "gps.csv").write_text(csv_text({"stamp": 5000.01 + SECONDS, **FIXES, **changes}))
    keys = {**GNSS, "file": "gps.csv", "time": {"column": "stamp"}, **(gnss or {})}
    return convert(path, noisy(), {"gnss": keys}, PLACELESS if given is None else given)
