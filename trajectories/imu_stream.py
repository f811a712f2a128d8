"""The imu stream: rows to increments, with all that can be wrong in its values and times."""

import numpy as np
from numpy.typing import NDArray

from ins.records import ImuLog, Span
from trajectories.run_check import (
    Findings,
    check_finite,
    check_gaps,
    check_increasing,
    check_rate,
    dropout_spans,
    find_dropouts,
    hold_over_dropouts,
)
from trajectories.run_schema import imu_columns
from trajectories.stream_files import StreamFile


def load_imu(stream: StreamFile, findings: Findings) -> tuple[ImuLog | None, list[Span]]:
    """The imu stream as increments, with its faults; None once an error was found.

    A row of rates is the mean over the interval that ends at its time, so increment = rate x interval.
    """
    names = imu_columns(stream.names)
    errors = len(findings.errors)
    time_s = stream.column("time_s")
    vectors = np.empty((2, time_s.size, 3))  # dtheta, dv
    for k, name in enumerate(names[1:]):
        column = stream.column(name)
        findings.error(*check_finite(column, name, stream.row))
        vectors[k // 3, :, k % 3] = column
    findings.error(*check_finite(time_s, "time_s", stream.row))
    if time_s.size < 2:
        findings.error(f"{stream.label}: {time_s.size} rows, needed at least 2")
    elif len(findings.errors) == errors:
        findings.error(*check_increasing(time_s, stream.row))
    if len(findings.errors) == errors:
        findings.error(*check_gaps(time_s, stream.row), *check_rate(time_s, stream.row, stream.label))
    if len(findings.errors) > errors:
        return None, []
    return imu_log(time_s, vectors[0], vectors[1], source="rates" if "gyro_x_rad_s" in names else "increments")


def imu_log(time_s: NDArray, dtheta: NDArray, dv: NDArray, *, source: str) -> tuple[ImuLog, list[Span]]:
    """Rates (per second) or increments, (n, 3) each and changed in place, as a log with its dropouts held over."""
    nominal = float(np.median(np.diff(time_s)))
    dt_s = np.concatenate([[nominal], np.diff(time_s)])
    rows, lost = find_dropouts(time_s)
    if source == "rates":
        dtheta *= dt_s[:, None]
        dv *= dt_s[:, None]
    else:
        hold_over_dropouts(dtheta, dv, dt_s, rows, nominal_s=nominal)
    log = ImuLog(time_s=time_s, dt_s=dt_s, dtheta_rad=dtheta, dv_m_s=dv, source=source)
    return log, dropout_spans(time_s, rows, lost)
