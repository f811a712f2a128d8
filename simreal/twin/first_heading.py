"""The heading of the first stand of a run, from all that its sensors say of it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment import coarse, gyrocompass
from alignment.motion.stillness import Motion
from alignment.navigation_filter import Aid
from alignment.result import BiasPrior, Solution
from infield.session.navigated import SessionSettings, session_end
from infield.session.taxi_heading import (
    CentreLineAid,
    GnssAid,
    LateralAid,
    OdometerAid,
    SurveyedHeadingAid,
)
from infield.table.merge import session_covariance
from ins.attitude import dcm_from_rotation_vector, euler_from_dcm
from ins.earth import EARTH_RATE_RAD_S, dcm_en, ecef_from_geodetic, geodetic_from_ecef
from ins.filters import error_model as em
from ins.records import GnssLog, ImuSource, Run, TwinModel
from ins.strapdown.mechanization import VerticalChannel
from ins.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MILLIRADIAN, PPM

BIN_S, WARM_UP_S = 300.0, 1800.0
SETTINGS = SessionSettings()


@dataclass(frozen=True)
class FirstHeading:
    """heading [rad] and its sigma (inf: not known); source: gyrocompass, survey or assumed; motion:
    None if not navigated.
    """

    heading_rad: float
    sigma_rad: float
    source: str
    motion: Motion | None = None


def first_heading(
    run: Run, imu: ImuSource, twin: TwinModel, rest: tuple[float, float]
) -> FirstHeading:
    """Gyrocompass heading with turns, odometer, GNSS and survey; without one, the survey's, else 0
    with sigma inf.

    imu: compensated with what the twin believes; rest: the first one. `run.gnss` only serves
    relative to its first fixes.
    """
    survey = run.header.survey
    means = coarse.rest_means(imu.between(*rest))
    unknown = gyrocompass.unknown_bias_sigma_deg_h(twin, means)
    sees = _sees_earth_rate(run, twin, means, unknown)
    if sees:
        solution = _navigated(run, imu, twin, rest, unknown)
        theta = solution.filter.x[em.THETA_START]
        C_nb = dcm_from_rotation_vector(-theta) @ solution.history.C_nb[0]
        down = em.THETA_START.stop - 1
        sigma = float(np.sqrt(solution.filter.P[down, down]))
        return FirstHeading(float(euler_from_dcm(C_nb)[2]), sigma, "gyrocompass", solution.motion)
    if survey.heading_rad is not None:
        return FirstHeading(survey.heading_rad, survey.sigma_heading_rad or 1e-3, "survey")
    return FirstHeading(0.0, float("inf"), "assumed")


def _sees_earth_rate(
    run: Run, twin: TwinModel, means: coarse.RestMeans, unknown_deg_h: float
) -> bool:
    """As in `gyrocompass.align`: gyro uncertainty well below level Earth rate, not too near a
    pole.
    """
    level = EARTH_RATE_RAD_S * np.cos(run.header.site.lat_rad)
    noise = twin.gyro.arw_deg_sqrt_h * DEG_PER_SQRT_HOUR / np.sqrt(means.seconds)
    uncertain = np.hypot(unknown_deg_h, twin.gyro.turn_on_deg_h) * DEG_PER_HOUR + noise
    return bool(
        uncertain < gyrocompass.LEVEL_SHARE * level
        and abs(run.header.site.lat_rad) < gyrocompass.MAX_LATITUDE_RAD
    )


def _navigated(
    run: Run, imu: ImuSource, twin: TwinModel, rest: tuple[float, float], unknown_deg_h: float
) -> Solution:
    end_s = session_end(run)
    survey = run.header.survey
    sigma0 = {
        "KAPPA": SETTINGS.sigma_crab_mrad * MILLIRADIAN,
        "LEVER_X": SETTINGS.sigma_lever_arm_m,
        "ODOMETER": SETTINGS.sigma_odometer_scale,
        "CENTRE_LINE": survey.sigma_centre_line_rad or 0.0,
        "SCALE_Z": SETTINGS.sigma_scale_factor_ppm[run.header.gyro_technology] * PPM,
    }
    vertical = VerticalChannel(mode="hold")
    if run.gnss is not None:
        vertical = VerticalChannel(mode="aided", time_s=run.gnss.time_s, height_m=run.gnss.height_m)
    return gyrocompass.solve(
        imu,
        run.header.site,
        twin,
        _bias_prior(twin, rest[0], end_s, unknown_deg_h),
        rest=rest,
        phases=run.phases,
        sigma0=sigma0,
        aids=_aids(run, twin, rest[1]),
        vertical=vertical,
        until_s=end_s,
    )


def _bias_prior(twin: TwinModel, start_s: float, end_s: float, unknown_deg_h: float) -> BiasPrior:
    """What a session does to a bias, and a smooth drift as large as that of a unit without a table:
    effects to be found.
    """
    edges = np.linspace(start_s, end_s, max(round((end_s - start_s) / BIN_S), 1) + 1)
    count, centre = len(edges) - 1, 0.5 * (edges[1:] + edges[:-1])
    own = session_covariance(
        axis_index=np.tile(np.arange(3), count),
        time_s=np.repeat(centre, 3),
        duration_s=np.repeat(np.diff(edges), 3),
        gyro=twin.gyro,
        run_length_s=end_s,
    )
    lag = (centre[:, None] - centre[None, :]) / WARM_UP_S
    drift = 0.5 + 0.5 * np.exp(-0.5 * lag**2) + 1e-4 * np.eye(count)
    return BiasPrior(edges, (own + np.kron(unknown_deg_h**2 * drift, np.eye(3))) * DEG_PER_HOUR**2)


def _aids(run: Run, twin: TwinModel, stood_s: float) -> list[Aid]:
    header, survey = run.header, run.header.survey
    aids: list[Aid] = [LateralAid(header.wheel_reference_m)]
    if run.odometer is not None:
        aids.append(OdometerAid(run.odometer, twin.odometer.noise_m_s, header.wheel_reference_m))
    if run.gnss is not None:
        aids.append(
            GnssAid(
                run.gnss,
                header.gnss_lever_arm_m,
                twin.gnss.sigma_horizontal_m,
                twin.gnss.sigma_velocity_m_s,
            )
        )
    if survey.heading_rad is not None and survey.sigma_heading_rad:
        aids.append(SurveyedHeadingAid(survey.heading_rad, survey.sigma_heading_rad, stood_s))
    if survey.centre_line_rad is not None and survey.sigma_centre_line_rad:
        aids.append(CentreLineAid(survey.centre_line_rad))
    return aids


def relative_to_site(gnss: GnssLog, run: Run, C_nb: NDArray, rest: tuple[float, float]) -> GnssLog:
    """The fixes moved by one vector, so that those of the first rest (else the first fix) belong to
    the entered site.

    The twin starts from the site; a site that contradicts GNSS must show in the comparison, not in
    the motion. Latitude and longitude stay those of the antenna, the height becomes that of the
    IMU.
    """
    site, header = run.header.site, run.header
    C_en = dcm_en(site.lat_rad, site.lon_rad)
    antenna_e = ecef_from_geodetic(
        site.lat_rad, site.lon_rad, site.height_m
    ) + C_en @ C_nb @ np.asarray(header.gnss_lever_arm_m)
    rows = np.flatnonzero((gnss.time_s >= rest[0]) & (gnss.time_s <= rest[1]))
    rows = rows if rows.size else np.array([0])
    lat, lon, height = (
        values - np.median(values[rows]) for values in (gnss.lat_rad, gnss.lon_rad, gnss.height_m)
    )
    lat0, lon0, _ = geodetic_from_ecef(antenna_e)
    return replace(gnss, lat_rad=lat + lat0, lon_rad=lon + lon0, height_m=height + site.height_m)
