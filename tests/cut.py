"""Cut a stretch out of a run: a run of its own, on the same clock.

Times and `start_utc` stay those of the whole run, since `time_s` is also the time since power-on,
which a warm-up or a ramp depends on: two halves of a run can then be compared, and what was fitted
to one predicts the other.
"""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from ins.records import ImuLog, ImuSource, InputError, Phase, Run, Site, Span
from trajectories.runs.checks import DROPOUT
from trajectories.runs.directory import run_sha256

MARGIN_S = 1e-9  # of time stamps that were computed: a double at 1e6 s is rounded by 1e-10 s


def cut_run(run: Run, start_s: float, end_s: float, *, site: Site | None = None) -> Run:
    """The rows of a run from start_s to end_s [s of its clock], as a run whose id names them.

    imu rows are kept whose whole interval lies inside; samples of the other streams by their time;
    phases and faults are clipped. `site` is where the vehicle stands at start_s, to be given where
    it is not the run's own any more. InputError where fewer than two imu rows are left.
    """
    imu = _cut_imu(run.imu, start_s, end_s)
    header = replace(
        run.header,
        run_id=f"{run.header.run_id}-{start_s:g}-{end_s:g}s",
        site=site or run.header.site,
    )
    out = Run(
        header=header,
        imu=imu,
        **{name: _cut_log(getattr(run, name), start_s, end_s) for name in _LOGS},
        phases=tuple(
            _clipped(p, start_s, end_s) for p in run.phases if _overlaps(p, start_s, end_s)
        ),
        faults=tuple(
            _clipped(s, start_s, end_s) for s in run.faults if _overlaps(s, start_s, end_s)
        ),
    )
    return replace(out, sha256=run_sha256(out))


_LOGS = ("temperature", "gnss", "odometer")


def _cut_imu(source: ImuSource, start_s: float, end_s: float) -> ImuLog:
    """Rows whose interval is inside, from the first that follows no dropout on; its interval
    becomes the nominal one.

    A reader of the cut run takes the first interval as nominal, so the first row is scaled to that
    (its rates kept).
    """
    nominal_s = 1.0 / source.rate_hz
    held = f"{source.start_s:g} to {source.end_s:g} s"
    try:
        log = source.between(start_s, end_s + MARGIN_S)
    except InputError:  # no row, or one
        raise InputError(
            f"cut {start_s:g} to {end_s:g} s: not two imu rows (the run has {held})"
        ) from None
    first = np.flatnonzero(
        (log.time_s - log.dt_s >= start_s - MARGIN_S) & (log.dt_s <= DROPOUT * nominal_s)
    )
    rows = slice(int(first[0]), None) if first.size else slice(0)
    time_s, dt_s, dtheta, dv = (
        np.array(getattr(log, k)[rows]) for k in ("time_s", "dt_s", "dtheta_rad", "dv_m_s")
    )
    if time_s.size < 2:
        raise InputError(f"cut {start_s:g} to {end_s:g} s: not two imu rows (the run has {held})")
    nominal_s = float(np.median(np.diff(time_s)))
    scale, dt_s[0] = nominal_s / dt_s[0], nominal_s
    dtheta[0] *= scale
    dv[0] *= scale
    return ImuLog(time_s=time_s, dt_s=dt_s, dtheta_rad=dtheta, dv_m_s=dv, source=log.source)


def _cut_log(log: Any, start_s: float, end_s: float) -> Any:
    """The samples of a stream with start_s <= time_s <= end_s; None where it is None or holds none
    of them.
    """
    if log is None:
        return None
    rows = (log.time_s >= start_s - MARGIN_S) & (log.time_s <= end_s + MARGIN_S)
    if not rows.any():
        return None
    columns = {f.name: getattr(log, f.name) for f in fields(log)}
    return replace(log, **{k: v[rows] for k, v in columns.items() if isinstance(v, np.ndarray)})


def _overlaps(span: Span | Phase, start_s: float, end_s: float) -> bool:
    return max(span.start_s, start_s) < min(span.end_s, end_s)


def _clipped(span: Any, start_s: float, end_s: float) -> Any:
    return replace(span, start_s=max(span.start_s, start_s), end_s=min(span.end_s, end_s))
