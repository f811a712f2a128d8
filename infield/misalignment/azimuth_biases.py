"""What the gyros of parked stops show beyond table and Earth rate, with the joint covariance of it
all.

Per stop and gyro: angle random walk; per run: turn-on, flicker, random walk
(`infield.table.merge.session_covariance`); over all: the table's own uncertainty at the
temperatures of the stops; and what levels and azimuths do not know.

Decision: docs/decisions/0015-unknown-azimuths.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from infield.misalignment.azimuth_runs import (
    AzimuthStop,
    coarse_headings,
    excess_rad_s,
    level_columns,
)
from infield.misalignment.harmonic_fit import azimuth_columns, fit_azimuths, level_rate_deg_h
from infield.misalignment.reasons import MisalignmentNote
from infield.session.settings import SessionSettings
from infield.table.merge import session_covariance
from infield.table.thermal_table import ThermalTable
from infield.thermometer.gyro_temperature import gyro_temperature, plausible_range, too_short
from ins.attitude import wrap_pi
from ins.records import AXES, Run, Site, TwinModel
from ins.units import ARCSEC, DEG, DEG_PER_HOUR, HOUR, MICRO_G, PPM
from ins.verdicts import Reason, because

MAX_ROUNDS = 30
SETTLED_RAD = 1e-7  # of azimuth: 15 deg/h x 1e-7 is 1.5e-6 deg/h on a gyro
# between stops: 2 degC apart, the default table of a ring-laser unit (formats.md section 2)
# differs by 4e-4 deg/h (1 sigma), near the 0.001 of a study's noise (R21)
NOTED_DEGC = 2.0
# of a table's variance that a stop without temperature has for itself (formats.md section 2)
UNTIED_SHARE = 0.3


@dataclass(frozen=True, kw_only=True)
class KnownAzimuths:
    """Headings (m,) that a person gives for the stops, in order, and how well: of each stop by
    itself, and of north.
    """

    heading_rad: NDArray
    sigma_stop_rad: float
    sigma_north_rad: float


@dataclass(frozen=True, kw_only=True)
class StopBiases:
    """Input of `fog_azimuths.measure_misalignment`, and the temperatures it is about.

    heading_rad (m,); bias_deg_h (m, 3); covariance (3m, 3m); unknown (3m, q) or None: headings that
    nobody gave, one a run; temperature_degC (m, 3), NaN where not known; notes: what a reader must
    know.
    """

    heading_rad: NDArray
    bias_deg_h: NDArray
    covariance: NDArray
    unknown: NDArray | None
    temperature_degC: NDArray
    notes: tuple[Reason, ...] = ()


def stop_biases(
    runs: Sequence[Run],
    stops: Sequence[AzimuthStop],
    table: ThermalTable,
    twin: TwinModel,
    known: KnownAzimuths | None,
) -> StopBiases:
    """Biases of the stops of some runs of one unit; `known` None: the azimuths are found with the
    gyros.
    """
    site = runs[0].header.site
    H, tied, T, notes = _table_rows(runs, stops, table)
    covariance = H @ table.covariance @ H.T + _session_terms(runs, stops, twin)
    _untied(covariance, table, tied)
    rate = level_rate_deg_h(site.lat_rad)
    taken = (H @ table.parameters).reshape(-1, 3)
    if known is not None:
        heading, unknown = known.heading_rad, None
        one = np.ones(heading.size)
        of_azimuth = known.sigma_stop_rad**2 * np.diag(one) + known.sigma_north_rad**2 * np.outer(
            one, one
        )
    else:
        of_azimuth = _turn_covariance(runs, stops)
        heading = _found_headings(stops, site, covariance, taken, of_azimuth, scale_sigma(runs[0]))
        unknown = azimuth_columns(heading, rate) @ _membership(stops)
    covariance += _azimuth_and_level(stops, heading, of_azimuth, site, twin)
    excess = excess_rad_s(stops, heading, site.lat_rad) / DEG_PER_HOUR - taken
    return StopBiases(
        heading_rad=np.mod(heading, 2 * np.pi),
        bias_deg_h=excess,
        covariance=covariance,
        unknown=unknown,
        temperature_degC=T,
        notes=tuple(notes),
    )


def _azimuth_and_level(
    stops: Sequence[AzimuthStop], heading: NDArray, of_azimuth: NDArray, site: Site, twin: TwinModel
) -> NDArray:
    """Covariance (3m, 3m) that errors of azimuth, (m, m) [rad^2], and of level make."""
    rate = level_rate_deg_h(site.lat_rad)
    columns = azimuth_columns(heading, rate)
    return columns @ of_azimuth @ columns.T + _level_covariance(stops, heading, site, twin)


def _table_rows(
    runs: Sequence[Run], stops: Sequence[AzimuthStop], table: ThermalTable
) -> tuple[NDArray, NDArray, NDArray, list[Reason]]:
    """Rows (3m, n) of the table at the stops, which of them (m, 3) have a temperature, the
    temperatures, and notes.
    """
    H = np.zeros((3 * len(stops), table.n_parameters))
    tied = np.zeros((len(stops), 3), dtype=bool)
    T = np.full((len(stops), 3), np.nan)
    notes: list[Reason] = []
    for index, run in enumerate(runs):
        why = too_short(run.temperature)
        if why or run.temperature is None:
            notes.append(
                because(MisalignmentNote.NO_TEMPERATURE, run_id=run.header.run_id, shortage=why)
            )
            continue
        temperature = gyro_temperature(run.temperature, plausible_degC=plausible_range(table))
        for j in (j for j, stop in enumerate(stops) if stop.run == index):
            rows = temperature.mean_rows(stops[j].start_s, stops[j].end_s)
            seen = rows > 0
            for k, axis in enumerate(AXES):
                if axis not in temperature.unusable:
                    tied[j, k], T[j, k] = True, rows @ temperature.temperature_degC[:, k]
                    H[3 * j + k] = rows[seen] @ table.basis(
                        k, temperature.temperature_degC[seen, k]
                    )
    whole = T[np.isfinite(T).all(axis=1)]
    spread = float(np.ptp(whole, axis=0).max()) if whole.size else 0.0
    if spread > NOTED_DEGC:
        notes.append(because(MisalignmentNote.TEMPERATURES_APART, spread_degC=spread))
    return H, tied, T, notes


def _untied(covariance: NDArray, table: ThermalTable, tied: NDArray) -> None:
    """In place: a stop without a temperature may have any bias of the table."""
    for j, k in zip(*np.nonzero(~tied)):
        values = table.values_of(int(k))
        spread = np.max(np.diag(table.covariance)[values]) + np.var(table.parameters[values])
        covariance[3 * j + k, 3 * j + k] += UNTIED_SHARE * spread


def _session_terms(runs: Sequence[Run], stops: Sequence[AzimuthStop], twin: TwinModel) -> NDArray:
    """Noise of the stops (3m, 3m) [(deg/h)^2]: correlated within a run, not between runs."""
    out = np.zeros((3 * len(stops), 3 * len(stops)))
    for index, run in enumerate(runs):
        at = [j for j, stop in enumerate(stops) if stop.run == index]
        if not at:
            continue
        rows = np.concatenate([[3 * j, 3 * j + 1, 3 * j + 2] for j in at])
        own = [stops[j] for j in at]
        out[np.ix_(rows, rows)] = session_covariance(
            axis_index=np.tile(np.arange(3), len(at)),
            time_s=np.repeat([0.5 * (s.start_s + s.end_s) for s in own], 3),
            duration_s=np.repeat([s.end_s - s.start_s for s in own], 3),
            gyro=twin.gyro,
            run_length_s=run.imu.end_s,
        )
    hours = np.array([s.used_s for s in stops]) / HOUR
    out[np.diag_indices_from(out)] += np.repeat(twin.gyro.arw_deg_sqrt_h**2 / hours, 3)
    creep_deg = twin.vehicle.yaw_creep_arcsec_sqrt_h * ARCSEC / DEG
    out[np.arange(2, len(out), 3), np.arange(2, len(out), 3)] += creep_deg**2 / hours
    return out


def _membership(stops: Sequence[AzimuthStop]) -> NDArray:
    """(m, runs): 1 where a stop belongs to a run."""
    number = np.unique([s.run for s in stops], return_inverse=True)[1]
    return np.eye(number.max() + 1)[number]


def _turn_covariance(runs: Sequence[Run], stops: Sequence[AzimuthStop]) -> NDArray:
    """Of headings followed by the vertical gyro since the first stop of a run, (m, m) [rad^2]."""
    scale = scale_sigma(runs[0])
    turn = np.array([s.turn_rad for s in stops])
    variance = np.array([s.turn_variance_rad2 for s in stops])
    walk = np.minimum.outer(variance, variance)
    same = _membership(stops) @ _membership(stops).T
    return same * (scale**2 * np.outer(turn, turn) + walk)


def scale_sigma(run: Run) -> float:
    """Sigma of a scale factor of the run's unit, as a session assumes it."""
    return SessionSettings().sigma_scale_factor_ppm[run.header.gyro_technology] * PPM


def _level_covariance(
    stops: Sequence[AzimuthStop], heading: NDArray, site: Site, twin: TwinModel
) -> NDArray:
    """What accelerometer biases make of the biases through the level (3m, 3m)."""
    accel, m = twin.accel, len(stops)
    hours = np.array([s.end_s for s in stops]) / HOUR
    own = np.diag(accel.bias_instability_ug**2 + accel.rate_random_walk_ug_sqrt_h**2 * hours)
    shared = _membership(stops)
    of_bias = (accel.turn_on_ug**2 * shared @ shared.T + own) * (MICRO_G / DEG_PER_HOUR) ** 2
    out = np.zeros((3 * m, 3 * m))
    for axis in range(2):
        columns = np.zeros((3 * m, m))
        for j, stop in enumerate(stops):
            columns[3 * j : 3 * j + 3, j] = level_columns(
                stop, float(heading[j]), site.lat_rad, site.height_m
            )[:, axis]
        out += columns @ of_bias @ columns.T
    return out


def _found_headings(
    stops: Sequence[AzimuthStop],
    site: Site,
    covariance: NDArray,
    table_deg_h: NDArray,
    of_azimuth: NDArray,
    own_axis_sigma_rad: float,
) -> NDArray:
    """Headings (m,) from the gyros: one unknown a run, the turns within it followed, biases solved
    for at the same time.
    """
    member, rate = _membership(stops), level_rate_deg_h(site.lat_rad)
    turn = np.array([s.turn_rad for s in stops])
    known = [
        replace(s, gyro_rad_s=s.gyro_rad_s - b * DEG_PER_HOUR) for s, b in zip(stops, table_deg_h)
    ]
    first = np.exp(1j * (coarse_headings(known, np.zeros(3)) - turn))
    heading = turn + member @ np.angle(member.T @ first)
    for _ in range(MAX_ROUNDS):
        columns = azimuth_columns(heading, rate)
        excess = excess_rad_s(known, heading, site.lat_rad) / DEG_PER_HOUR
        R = covariance + columns @ of_azimuth @ columns.T
        off = fit_azimuths(
            heading,
            excess,
            R,
            level_rate_deg_h=rate,
            unknown=columns @ member,
            own_axis_sigma_rad=own_axis_sigma_rad,
        ).unknowns
        heading = wrap_pi(heading - member @ off)
        if np.max(np.abs(off)) < SETTLED_RAD:
            break
    return np.asarray(heading)


def azimuth_reach_deg_h(table: ThermalTable, twin: TwinModel) -> float:
    """Bias sigma of a level gyro [deg/h], to be held against the level Earth rate before an azimuth
    is looked for.
    """
    variance = max(
        float(np.max(np.diag(table.covariance)[table.values_of(axis)])) for axis in (0, 1)
    )
    return float(np.hypot(np.sqrt(variance), twin.gyro.turn_on_deg_h))
