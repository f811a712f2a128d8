"""Satellite fixes while parked against the entered site: one-minute means, whitened, and what they
say of the site.
"""

import numpy as np
from numpy.typing import NDArray

from ins.earth import displacement_ned
from ins.errors.telemetry import Trace
from ins.records import TwinModel
from simreal.evidence.run_view import RunView

FIX_MEAN_S = 60.0
SITE_SIGMA_M = 30.0  # how well a crew knows where it is parked
FIX_COMPONENTS = 4  # north, east [m], velocity north, east [m/s]


class ParkedFixes:
    """Rows (4 * bins) of one run's fixes in its parked stretch; none without GNSS.

    The position of the site is an unknown of SITE_SIGMA_M; beyond that a site contradicts GNSS.
    """

    def __init__(self, view: RunView, twin: TwinModel) -> None:
        gnss, site = view.run.gnss, view.run.header.site
        self.time_s: NDArray
        self._count: NDArray
        self.time_s, self._count, self._mean = (
            np.zeros(0),
            np.zeros(0),
            np.zeros((FIX_COMPONENTS, 0)),
        )
        self._sigma = np.array(
            [twin.gnss.sigma_horizontal_m] * 2 + [twin.gnss.sigma_velocity_m_s] * 2
        )
        self._start_s, self._end = view.start_s, view.seconds.end_s
        if gnss is None:
            return
        inside = (
            (gnss.time_s > view.start_s)
            & (gnss.time_s <= view.end_s)
            & np.isfinite(gnss.lat_rad + gnss.lon_rad)
        )
        inside &= np.isfinite(gnss.v_n_m_s).all(axis=1)
        if not inside.any():
            return
        at = ((gnss.time_s[inside] - view.start_s - 1e-6) // FIX_MEAN_S).astype(int)
        arm = view.C_nb @ np.asarray(view.run.header.gnss_lever_arm_m, dtype=float)
        way = displacement_ned(
            gnss.lat_rad[inside],
            gnss.lon_rad[inside],
            lat0_rad=site.lat_rad,
            lon0_rad=site.lon_rad,
            height0_m=site.height_m,
        )
        values = np.hstack([way[:, :2] - arm[:2], gnss.v_n_m_s[inside, :2]])
        count = np.bincount(at)
        used = np.flatnonzero(count)
        self._count = count[used].astype(float)
        self.time_s = view.start_s + FIX_MEAN_S * (used + 1.0)
        self._mean = np.stack([np.bincount(at, v)[used] / self._count for v in values.T])

    @property
    def rows(self) -> int:
        return FIX_COMPONENTS * self.time_s.size

    def whiten_data(self) -> tuple[NDArray, NDArray]:
        """Whitened rows (rows,) and the position error of the entered site that they show (2,) [m],
        site less truth.
        """
        z, offset = self._whiten(self._mean[:, :, None])
        return z[:, 0], offset[:, 0]

    def whiten(self, traces: list[Trace]) -> tuple[NDArray, NDArray]:
        """The same of what effects add: (rows, m), (2, m)."""
        out = np.zeros((FIX_COMPONENTS, self.time_s.size, len(traces)))
        ends = np.searchsorted(self._end, self.time_s + 1e-6)
        for k, trace in enumerate(traces):
            for offset, values in ((0, trace.gnss_position_m), (2, trace.gnss_velocity_m_s)):
                if values is not None:
                    sums = np.vstack([np.zeros((1, 2)), np.cumsum(values[:, :2], axis=0)])
                    first = np.maximum(ends - int(FIX_MEAN_S), 0)
                    out[offset : offset + 2, :, k] = (
                        (sums[ends] - sums[first]) / np.maximum(ends - first, 1)[:, None]
                    ).T
        return self._whiten(out)

    @property
    def site_variance_m2(self) -> float:
        """What is left of the site's uncertainty, north and east alike."""
        return float(1.0 / (SITE_SIGMA_M**-2 + self._count.sum() / self._sigma[0] ** 2))

    def _whiten(self, values: NDArray) -> tuple[NDArray, NDArray]:
        root = np.sqrt(self._count)
        z = values * root[None, :, None] / self._sigma[:, None, None]
        if not self.time_s.size:
            return z.reshape(0, values.shape[2]), np.zeros((2, values.shape[2]))
        # the site's error spreads over the bins of a component as root
        known = np.sqrt(self._count.sum())
        s = SITE_SIGMA_M * known / self._sigma[0]
        unit = root / known
        along = np.einsum("b,cbm->cm", unit, z[:2])
        offset = -along * self._sigma[0] / known * s**2 / (1.0 + s**2)
        z[:2] -= (1.0 - 1.0 / np.sqrt(1.0 + s**2)) * unit[None, :, None] * along[:, None, :]
        return z.reshape(self.rows, -1), offset
