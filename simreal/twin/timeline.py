"""The sample times of a log: an even clock, or not."""

import numpy as np

from ins.records import ImuSource

EVEN_SHARE = 0.02  # of an interval that a stamp may be off an even clock: rounding of the file
SLOWEST_HZ, FASTEST_HZ = 10.0, 2000.0  # that sensors are simulated at


def even_rate(imu: ImuSource) -> tuple[float, bool]:
    """Rate [Hz] to simulate a log at, and whether its stamps are those of one even clock at that
    rate.

    Where they are not (lost rows, jitter), the nominal rate.
    """
    mean_hz = (imu.rows - 1) / (imu.end_s - imu.start_s)
    row, worst = 0, 0.0
    for piece in imu.pieces():
        even_s = imu.start_s + (row + np.arange(piece.rows)) / mean_hz
        worst = max(worst, float(np.max(np.abs(piece.time_s - even_s))))
        row += piece.rows
    even = worst * mean_hz < EVEN_SHARE and SLOWEST_HZ * (1 - 1e-9) <= mean_hz <= FASTEST_HZ
    rate_hz = mean_hz if even else imu.rate_hz
    return float(np.clip(rate_hz, SLOWEST_HZ, FASTEST_HZ)), even
