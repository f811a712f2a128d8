"""Misalignment from runs on several azimuths, or from a table of biases: the spine of `recal
misalignment`::

    runs -> stops -> biases with covariance -> couplings, verdicts, accelerometer offsets
        -> a twin that carries them
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from infield.misalignment.azimuth_biases import (
    KnownAzimuths,
    azimuth_reach_deg_h,
    scale_sigma,
    stop_biases,
)
from infield.misalignment.azimuth_runs import AzimuthStop, find_stops, heading_disagreement
from infield.misalignment.couplings import Misalignment, measure_misalignment, with_heading_errors
from infield.misalignment.geometry import AzimuthSettings, azimuth_geometry
from infield.misalignment.harmonic_fit import azimuth_columns, level_rate_deg_h
from infield.misalignment.reasons import Azimuths, MisalignmentReason, MisalignmentVerdict, Unseen
from infield.table.least_squares import fit_correlated
from infield.table.thermal_table import ThermalTable
from ins.earth import gravity_magnitude
from ins.records import AXES, AccelNoise, InputError, Run, Site, TwinModel
from ins.robust import chi2 as chi_square
from ins.strapdown.compensation import OFF_DIAGONAL
from ins.units import ARCSEC, DEG, HOUR, MICRO_G, MILLIRADIAN, STANDARD_GRAVITY
from ins.verdicts import Observability, Reason, because

CONFIDENCE = 0.999  # 1 of 1000 sound studies is said to disagree
FLOOR_UG = 1.0  # of a stop's level: mean of sway and of the last digit of a table's bearing


@dataclass(frozen=True, kw_only=True)
class LevelOffsets:
    """offset_ug, sigma_offset_ug (2,): x and y, bias and mounting together, mean over the
    power-ons; ground_tilt_arcsec (2,): slope to north and east (p, q over g); chi2 with dof: that
    the ground was the same under all stops; bias_ug, sigma_bias_ug (2,): where the sigma of the
    mounting is known.
    """

    offset_ug: NDArray
    sigma_offset_ug: NDArray
    ground_tilt_arcsec: NDArray
    chi2: float
    dof: int
    bias_ug: NDArray | None
    sigma_bias_ug: NDArray | None
    sigma_mounting_arcsec: float | None

    @property
    def same_ground(self) -> bool:
        return self.chi2 <= float(chi_square.ppf(CONFIDENCE, self.dof))


def level_offsets(
    stops: Sequence[AzimuthStop],
    heading_rad: NDArray,
    accel: AccelNoise,
    site: Site,
    sigma_mounting_arcsec: float | None = None,
) -> LevelOffsets | None:
    """Two-position levelling over all stops; None where their headings do not tell offset from
    tilt::

        f_x(H) = o_x + p cosH + q sinH,     f_y(H) = o_y - p sinH + q cosH

    o is the bias and g times the mounting angle, p and q the ground's tilt (Groves (2013), 5.6.1).
    `accel`: noise of the unit, its nominal bias being off the stops' means already; it is added
    back.
    """
    m = len(stops)
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    one, zero = np.ones(m), np.zeros(m)
    A = np.vstack([np.column_stack([one, zero, cos, sin]), np.column_stack([zero, one, -sin, cos])])
    if m < 2 or np.linalg.cond(A) > 10.0:
        return None
    f = np.array([s.f_m_s2 for s in stops])[:, :2].T.ravel() / MICRO_G
    same_run = np.equal.outer([s.run for s in stops], [s.run for s in stops])
    hours = np.array([s.end_s for s in stops]) / HOUR
    used = np.array([s.used_s for s in stops])
    steady = accel.bias_instability_ug**2 + FLOOR_UG**2
    own = steady + accel.rate_random_walk_ug_sqrt_h**2 * hours + accel.vrw_ug_sqrt_hz**2 / used
    R = np.kron(np.eye(2), accel.turn_on_ug**2 * same_run + np.diag(own))
    fit = fit_correlated(A, f, R)
    g_ug = float(gravity_magnitude(site.lat_rad, site.height_m)) / MICRO_G
    offset_ug = fit.x[:2] + np.asarray(accel.bias_ug)[:2]
    sigma_ug = np.sqrt(np.diag(fit.covariance)[:2])
    bias_ug = sigma_bias_ug = None
    if sigma_mounting_arcsec is not None:
        of_mounting = sigma_mounting_arcsec * ARCSEC * STANDARD_GRAVITY / MICRO_G
        bias_ug, sigma_bias_ug = offset_ug, np.hypot(sigma_ug, of_mounting)
    return LevelOffsets(
        offset_ug=offset_ug,
        sigma_offset_ug=sigma_ug,
        ground_tilt_arcsec=fit.x[2:] / g_ug / ARCSEC,
        chi2=fit.chi2,
        dof=fit.dof,
        bias_ug=bias_ug,
        sigma_bias_ug=sigma_bias_ug,
        sigma_mounting_arcsec=sigma_mounting_arcsec,
    )


# bias sigma over level Earth rate, beyond which no azimuth is found with the gyros; 0.3 rad is an
# azimuth with a sigma of 17 deg
MAX_REACH = 0.3
SAME_PLACE_DEG = 0.1  # of latitude: 0.1 deg is 0.17 % of the level Earth rate at 45 deg
# a given heading that the gyros contradict by more is a mistake, not an error of the table; as
# far as an azimuth may lie off its nominal place (R21)
GYRO_CHECK_DEG = 2.0
ENTRIES = tuple(AXES[i] + AXES[j] for i, j in zip(*OFF_DIAGONAL))


@dataclass(frozen=True, kw_only=True)
class AzimuthStudy:
    """What one call of `recal misalignment` found; the document and the page are made of it.

    heading_rad (m,), bias_deg_h (m, 3), covariance (3m, 3m): what was fitted, empty where nothing
    could be; stops: one a row, empty for a table; azimuths: where they come from; levels
    None: why_no_levels says why.
    """

    source: str
    unit: dict[str, str]
    lat_rad: float
    twin: TwinModel
    settings: AzimuthSettings
    azimuths: Reason
    result: Misalignment
    heading_rad: NDArray
    bias_deg_h: NDArray
    covariance: NDArray
    temperature_degC: NDArray | None = None
    runs: tuple[Run, ...] = ()
    stops: tuple[AzimuthStop, ...] = ()
    notes: tuple[Reason, ...] = ()
    levels: LevelOffsets | None = None
    why_no_levels: Reason | None = None


def study_runs(
    runs: Sequence[Run],
    table: ThermalTable,
    twin: TwinModel,
    *,
    known: KnownAzimuths | None = None,
    settings: AzimuthSettings | None = None,
    told: Callable[[str], None] = lambda words: None,
) -> AzimuthStudy:
    """Stops of one unit's runs at one place, fitted; `known`: headings of the stops in the order of
    the runs; told: of each run as its stops are looked for, and as they are compared.

    Raises InputError where the runs are of several units or places, or headings and stops differ in
    number.
    """
    settings = settings or AzimuthSettings()
    _check_runs(runs)
    stops, left_out = [], []
    for index, run in enumerate(runs):
        told(f"finding the stops of {run.header.run_id}")
        found, why = find_stops(run, twin, index=index, shortest_s=settings.shortest_s)
        stops += found
        left_out += why
    made = _Runs(runs, stops, table, twin, known, settings, left_out)
    reasons = made.refusals()
    if reasons:
        return made.refused(reasons)
    told("comparing the stops")
    biases = stop_biases(runs, stops, table, twin, known)
    site = runs[0].header.site
    result, covariance, of_headings = _measured(
        biases.heading_rad,
        biases.bias_deg_h,
        biases.covariance,
        level_rate_deg_h=level_rate_deg_h(site.lat_rad),
        unknown=biases.unknown,
        # an error of the latitude scales level Earth rate as an error of both scale factors would
        own_axis_sigma_rad=float(
            np.hypot(scale_sigma(runs[0]), np.tan(site.lat_rad) * site.sigma_lat_rad)
        ),
        settings=settings,
    )
    if result.fit is None and left_out:
        result = replace(result, reasons=(*result.reasons, *left_out))
    mounting = settings.sigma_mounting_arcsec
    levels = level_offsets(stops, biases.heading_rad, twin.accel, site, mounting)
    lost = because(Unseen.OFFSET_OR_TILT) if levels is None else None
    if levels is not None and not levels.same_ground:
        lost = because(Unseen.GROUND_DIFFERS, chi2=levels.chi2, dof=levels.dof)
    return replace(
        made.study(result),
        heading_rad=biases.heading_rad,
        bias_deg_h=biases.bias_deg_h,
        covariance=covariance,
        temperature_degC=biases.temperature_degC,
        levels=None if lost else levels,
        why_no_levels=lost,
        notes=(*left_out, *biases.notes, *of_headings),
    )


def _measured(
    heading_rad: NDArray,
    bias_deg_h: NDArray,
    covariance: NDArray,
    *,
    level_rate_deg_h: float,
    unknown: NDArray | None = None,
    own_axis_sigma_rad: float | None = None,
    settings: AzimuthSettings,
) -> tuple[Misalignment, NDArray, tuple[Reason, ...]]:
    """The couplings, the covariance that they were fitted with, and what that says of headings that
    were given (`unknown` None).
    """

    def measured(R: NDArray) -> Misalignment:
        return measure_misalignment(
            heading_rad,
            bias_deg_h,
            R,
            level_rate_deg_h=level_rate_deg_h,
            unknown=unknown,
            own_axis_sigma_rad=own_axis_sigma_rad,
            settings=settings,
        )

    result = measured(covariance)
    if unknown is not None:
        return result, covariance, ()
    wider, notes = with_heading_errors(
        result, covariance, own_axis_sigma_rad=own_axis_sigma_rad, settings=settings
    )
    return (measured(wider) if notes else result), wider, notes


@dataclass(frozen=True)
class _Runs:
    """The inputs of `study_runs`, to judge and to fill a study with."""

    runs: Sequence[Run]
    stops: list[AzimuthStop]
    table: ThermalTable
    twin: TwinModel
    known: KnownAzimuths | None
    settings: AzimuthSettings
    left_out: list[Reason]

    def refusals(self) -> list[Reason]:
        """Why nothing is fitted at all."""
        lat = self.runs[0].header.site.lat_rad
        if not self.stops:
            return self.left_out or [because(MisalignmentReason.NO_STOP)]
        if self.known is None:
            reach = azimuth_reach_deg_h(self.table, self.twin)
            if reach > MAX_REACH * level_rate_deg_h(lat):
                poor = because(
                    MisalignmentReason.AZIMUTHS_NOT_FOUND,
                    reach_deg_h=reach,
                    level_rate_deg_h=level_rate_deg_h(lat),
                )
                return [poor]
            return []
        given = self.known.heading_rad
        if given.size != len(self.stops):
            if self.left_out:
                miscounted = because(
                    MisalignmentReason.HEADINGS_MISCOUNTED,
                    headings=given.size,
                    stops=len(self.stops),
                )
                return [miscounted, *self.left_out]
            raise InputError(
                f"{given.size} headings given, the runs have {len(self.stops)} stops: needed one"
                " for each stop"
            )
        if not azimuth_geometry(given, max_off_deg=self.settings.max_off_deg).reasons:
            return self._contradicted(given, lat)
        return []

    def _contradicted(self, given: NDArray, lat_rad: float) -> list[Reason]:
        j, off = heading_disagreement(self.stops, given, lat_rad)
        noise = azimuth_reach_deg_h(self.table, self.twin) / level_rate_deg_h(lat_rad) / DEG
        if abs(off) / DEG <= GYRO_CHECK_DEG + 3.0 * noise:
            return []
        contradicted = because(
            MisalignmentReason.HEADING_CONTRADICTED,
            stop=j + 1,
            run_id=self.runs[self.stops[j].run].header.run_id,
            given_rad=given[j],
            seen_rad=np.mod(given[j] - off, 2.0 * np.pi),
        )
        return [contradicted]

    def study(self, result: Misalignment) -> AzimuthStudy:
        header, m = self.runs[0].header, 0
        return AzimuthStudy(
            source="runs",
            unit={"imu_serial": header.imu_serial, "gyro_technology": header.gyro_technology},
            lat_rad=header.site.lat_rad,
            twin=self.twin,
            settings=self.settings,
            azimuths=self._azimuths(),
            result=result,
            heading_rad=np.zeros(m),
            bias_deg_h=np.zeros((m, 3)),
            covariance=np.zeros((m, m)),
            runs=tuple(self.runs),
            stops=tuple(self.stops),
            notes=tuple(self.left_out),
            why_no_levels=because(Unseen.NOT_FITTED),
        )

    def _azimuths(self) -> Reason:
        if self.known is None:
            return because(Azimuths.FOUND)
        return because(
            Azimuths.GIVEN,
            sigma_stop_rad=self.known.sigma_stop_rad,
            sigma_north_rad=self.known.sigma_north_rad,
        )

    def refused(self, reasons: list[Reason]) -> AzimuthStudy:
        given = np.zeros(0) if self.known is None else self.known.heading_rad
        geometry = azimuth_geometry(
            given if given.size else np.zeros(1), max_off_deg=self.settings.max_off_deg
        )
        return self.study(
            Misalignment(
                verdict=MisalignmentVerdict.REFUSED, reasons=tuple(reasons), geometry=geometry
            )
        )


def _check_runs(runs: Sequence[Run]) -> None:
    first = runs[0].header
    for run in runs[1:]:
        h = run.header
        if (h.imu_serial, h.gyro_technology, h.gyro_mode) != (
            first.imu_serial,
            first.gyro_technology,
            first.gyro_mode,
        ):
            raise InputError(
                f"run {h.run_id}: unit {h.imu_serial}, {first.run_id} is of {first.imu_serial}:"
                " needed one unit"
            )
        if abs(h.site.lat_rad - first.site.lat_rad) > SAME_PLACE_DEG * DEG:
            raise InputError(
                f"run {h.run_id}: latitude {h.site.lat_rad / DEG:.3f} deg, run {first.run_id} is at"
                f" {first.site.lat_rad / DEG:.3f} deg: needed one place"
            )
    if len({run.sha256 for run in runs}) < len(runs):
        raise InputError(
            "the same run is given twice: needed one run for each azimuth, or one run with several"
            " stops"
        )


def study_table(
    heading_rad: NDArray,
    bias_deg_h: NDArray,
    sigma_deg_h: NDArray,
    *,
    lat_rad: float,
    twin: TwinModel,
    source: str,
    settings: AzimuthSettings | None = None,
) -> AzimuthStudy:
    """Self-calibrated biases (m, 3) with independent sigmas (m, 3) on headings (m,), fitted.

    The error that all headings share (`sigma_heading_deg` of the settings) looks like xy - yx, so
    that only xy + yx is free of it.
    """
    settings = settings or AzimuthSettings()
    rate = level_rate_deg_h(lat_rad)
    sigma_heading_rad = settings.sigma_heading_deg * DEG
    common = azimuth_columns(heading_rad, rate).sum(axis=1) * sigma_heading_rad
    covariance = np.diag(np.ravel(sigma_deg_h) ** 2) + np.outer(common, common)
    result, covariance, notes = _measured(
        heading_rad, bias_deg_h, covariance, level_rate_deg_h=rate, settings=settings
    )
    return AzimuthStudy(
        source=source,
        unit={"imu_serial": twin.imu_serial, "gyro_technology": twin.gyro_technology},
        lat_rad=lat_rad,
        twin=twin,
        settings=settings,
        azimuths=because(
            Azimuths.OF_TABLE, exact=sigma_heading_rad == 0.0, sigma_heading_rad=sigma_heading_rad
        ),
        why_no_levels=because(Unseen.NO_ACCELEROMETERS),
        result=result,
        heading_rad=heading_rad,
        bias_deg_h=bias_deg_h,
        covariance=covariance,
        notes=notes,
    )


def corrected_twin(study: AzimuthStudy) -> TwinModel:
    """The twin with the couplings that were observed added to its misalignment, and their sigmas
    beside it.

    Where xy + yx is seen, and neither xy nor yx is well, each takes half: the rest is a turn of the
    triad about down, which without a good north from outside no session can tell from its heading.
    What was not observed stays as it was.
    """
    gyro = study.twin.gyro
    value, sigma = list(gyro.misalignment_mrad), list(gyro.sigma_misalignment_mrad)
    for name, (found, spread) in _usable(study.result).items():
        k = ENTRIES.index(name)
        value[k], sigma[k] = value[k] + found / MILLIRADIAN, spread / MILLIRADIAN
    changes: dict[str, Any] = {
        "misalignment_mrad": tuple(value),
        "sigma_misalignment_mrad": tuple(sigma),
    }
    return replace(study.twin, gyro=replace(gyro, **changes))


def _usable(result: Misalignment) -> dict[str, tuple[float, float]]:
    """Entries to write down, value and sigma [rad]; none unless the result stands."""
    if result.verdict is not MisalignmentVerdict.MEASURED:
        return {}
    seen = {
        c.entry: (c.value_rad, c.sigma_rad)
        for c in result.couplings
        if c.verdict is not Observability.NOT_OBSERVABLE
    }
    both = seen.pop("xy+yx", None)
    pair = [c for c in result.couplings if c.entry in ("xy", "yx")]
    if both is not None and all(c.verdict is not Observability.OBSERVED for c in pair):
        seen |= dict.fromkeys(("xy", "yx"), (both[0] / 2, both[1] / 2))
    return seen
