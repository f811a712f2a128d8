"""Every kernel compiled once and kept: `python -m tests.compiled`, 40 s of CPU the first time.

The controller of several test processes starts it while they collect (conftest.py), so that none of
them compiles what another one does at the same time.
"""

from infield.aided.flight import navigate_aided
from infield.session.pipeline import update_calibration
from tests.infield.aided_cases import flown, ideal, twin_of
from tests.infield.sessions import TWIN, factory, simulated


def main() -> None:
    """A session with a taxi, then a flight, there and back."""
    update_calibration([simulated().run], factory(), TWIN)
    twin = twin_of("mems")
    run = flown(ideal(), twin, 1).run
    navigate_aided(run, run.imu, twin, rest=None, gyro_sigma_deg_h=None).with_smoothed()


if __name__ == "__main__":
    main()
