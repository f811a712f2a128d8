"""What the found effects cost a user: the parked stretch aligned and navigated with and without
them in the log.

Both solutions have the same noise, so their difference is the effects' alone. Only deterministic
effects on gyros and accelerometers have such a number.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from alignment import coarse
from infield.replay.drift import Drift, parked_drift
from infield.session.log import compensated_imu
from infield.table.thermal_table import ThermalTable
from ins.attitude import euler_from_dcm, wrap_pi
from ins.documents import written_as
from ins.errors.telemetry import Trace, total
from ins.records import ImuLog, ImuSource, NavState, TwinModel
from ins.strapdown.mechanization import VerticalChannel, navigate
from ins.units import ARCSEC
from simreal.evidence.run_view import RunView

ALIGN_S = 600.0  # 10 min, as in the reference scenario of requirements.md
LONGEST_NAVIGATION_S = 3600.0
# of navigation after the alignment; chosen: 10 min, over which an acceleration shows 0.735 of the
# tilt rate behind it (physics.md 6.3)
SHORTEST_NAVIGATION_S = 600.0
ARCMIN = 60.0 * ARCSEC
NO_TRACE = Trace()


@dataclass(frozen=True)
class NavigationEnd:
    """At the end of unaided navigation."""

    rate_nm_h: float
    speed_m_s: float


@dataclass(frozen=True, kw_only=True)
class UserLevel:
    """A parked run aligned over `align_s`, then free-inertial over `navigated_s`: as it is, and
    without the found effects.

    heading_change_arcmin : of the alignment, as it is less without.
    """

    run_id: str
    align_s: float
    navigated_s: float
    heading_change_arcmin: float
    as_it_is: NavigationEnd = field(metadata=written_as("with"))
    without: NavigationEnd


def user_level(
    view: RunView,
    trace: Trace,
    table: ThermalTable | None,
    twin: TwinModel,
    *,
    known: Trace = NO_TRACE,
) -> UserLevel | None:
    """The numbers of one run; None where it is parked too briefly, finds no north, or no effect
    touches its sensors.

    known : what the twin expects of the effects that it lists already; subtracted from both.
    """
    touched = any(v is not None and bool(np.any(v)) for v in (trace.gyro_rad_s, trace.accel_m_s2))
    start, end = view.start_s, min(view.end_s, view.start_s + ALIGN_S + LONGEST_NAVIGATION_S)
    if (
        not touched
        or not view.telemetry.heading_known
        or end - start < ALIGN_S + SHORTEST_NAVIGATION_S
    ):
        return None
    imu = compensated_imu(view.run, table, view.temperature, twin)
    as_it_is, heading = _flown(view, imu, known, start, end)
    without, heading_without = _flown(view, imu, total([known, trace]), start, end)
    return UserLevel(
        run_id=view.name,
        align_s=ALIGN_S,
        navigated_s=float(as_it_is.time_s[-1]),
        heading_change_arcmin=float(wrap_pi(heading - heading_without)) / ARCMIN,
        as_it_is=_end(as_it_is),
        without=_end(without),
    )


def _end(drift: Drift) -> NavigationEnd:
    return NavigationEnd(drift.rate_nm_h, float(drift.speed_m_s[-1]))


def _flown(
    view: RunView, imu: ImuSource, trace: Trace, start: float, end: float
) -> tuple[Drift, float]:
    """Drift from the end of the alignment, and the heading that the alignment gave."""
    align_end = start + ALIGN_S
    C_nb = coarse.gyrocompass_dcm(
        coarse.rest_means(_less(imu.between(start, align_end), view, trace))
    )
    initial = NavState(time_s=align_end, site=view.run.header.site, v_n_m_s=np.zeros(3), C_nb=C_nb)
    history = navigate(
        _pieces(imu, view, trace, align_end, end),
        initial,
        epoch_s=1.0,
        vertical=VerticalChannel(mode="hold"),
    )
    return parked_drift(history, view.run.header.site, end), float(euler_from_dcm(C_nb)[2])


def _pieces(
    imu: ImuSource, view: RunView, trace: Trace, start: float, end: float
) -> Iterator[ImuLog]:
    for piece in imu.pieces(start - 2.0, end):
        yield _less(piece, view, trace)


def _less(piece: ImuLog, view: RunView, trace: Trace) -> ImuLog:
    """The log less what the effects add; straight between the seconds of the trace."""
    middle, t = piece.time_s - 0.5 * piece.dt_s, view.telemetry.time_s

    def increments(rates: NDArray | None) -> NDArray | float:
        if rates is None:
            return 0.0
        return (
            np.stack([np.interp(middle, t, column) for column in rates.T], axis=1)
            * piece.dt_s[:, None]
        )

    return replace(
        piece,
        dtheta_rad=piece.dtheta_rad - increments(trace.gyro_rad_s),
        dv_m_s=piece.dv_m_s - increments(trace.accel_m_s2),
    )
