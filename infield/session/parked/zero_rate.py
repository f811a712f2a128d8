"""Zero rates of a parked unit, no table taken out: for `align`, and for the sigma of a new unit."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from alignment.motion.parked_seconds import ParkedSeconds, parked_places, parked_seconds
from infield.session.estimate import SessionEarth
from infield.session.log import compensated_seconds
from infield.session.parked.earth import session_earth
from infield.session.parked.rates import surveyed_first, white_noise
from infield.session.parked.stretches import MIN_PARKED_S, stationary_segments
from infield.session.settings import SessionSettings
from infield.thermometer.gyro_temperature import GyroTemperature
from ins.earth import EARTH_RATE_RAD_S
from ins.records import AXES, Run, TwinModel
from ins.units import DEG_PER_HOUR, HOUR


@dataclass(frozen=True, kw_only=True)
class ZeroRate:
    """Mean rate of one gyro at rest less what is known of Earth rate."""

    bias_deg_h: float
    sigma_deg_h: float


@dataclass(frozen=True, kw_only=True)
class ZeroRates:
    """Zero rates of the three gyros over the first stretch of rest, as logged."""

    start_s: float
    end_s: float
    heading_known: bool
    gyro: Mapping[str, ZeroRate]


def first_zero_rate(
    run: Run, twin: TwinModel, settings: SessionSettings
) -> tuple[ParkedSeconds, SessionEarth] | None:
    """Seconds and Earth rate of the first stretch, nothing of a table taken out; None where it
    never rests.
    """
    rests = stationary_segments(run)
    if rests.stretches:
        seconds = parked_seconds(compensated_seconds(run, None, None, twin), *rests.stretches[0])
    else:
        seconds = None
    if seconds is None or not seconds.still.any():
        return None
    return seconds, session_earth(
        run, [seconds], [], twin, settings, survey=surveyed_first(run, rests, seconds)
    )


def mean_zero_rate(run: Run, twin: TwinModel, settings: SessionSettings) -> ZeroRates | None:
    """Mean rate of the parked unit less what is known of Earth rate, as logged, with its sigma;
    None where it never rests.
    """
    first = first_zero_rate(run, twin, settings)
    if first is None:
        return None
    seconds, earth = first
    mean, used_s = seconds.means(-np.inf, np.inf)
    rate = mean[3:] / DEG_PER_HOUR - earth.known[0]
    sigma = np.sqrt(
        np.diag(earth.covariance) + white_noise(seconds, twin)[0] ** 2 / (used_s / HOUR)
    )
    return ZeroRates(
        start_s=float(seconds.start_s[0]),
        end_s=float(seconds.end_s[-1]),
        heading_known=bool(earth.heading_deg_h[0] == 0.0),
        gyro={
            axis: ZeroRate(bias_deg_h=float(b), sigma_deg_h=float(s))
            for axis, b, s in zip(AXES, rate, sigma)
        },
    )


def unknown_sigma_deg_h(
    run: Run, twin: TwinModel, temperature: GyroTemperature | None, least_deg_h: float
) -> float:
    """Sigma of the table of an unknown unit, widened by what its parked rates show: their size, and
    their change.

    A change over a span dT of temperature is set against what a table of that sigma allows there:
    sqrt(0.3) sigma sqrt(2 (1 - exp(-dT^2 / 2 l^2))), the smooth share of formats.md section 2.
    """
    log = compensated_seconds(run, None, None, twin)
    places: list[ParkedSeconds] = []
    for stretch in stationary_segments(run).stretches:
        places += parked_places(log, *stretch)
    spans = [span for place in places for span in _minutes(place)]
    rates = (
        np.array([seconds.means(a, b)[0][3:] for seconds, a, b in spans]).reshape(-1, 3)
        / DEG_PER_HOUR
    )
    rates = rates[np.isfinite(rates).all(axis=1)]
    if not rates.size:
        return least_deg_h
    earth = EARTH_RATE_RAD_S / DEG_PER_HOUR
    size = float(np.abs(rates).max()) - earth
    if temperature is None or len(rates) < 2:
        return max(least_deg_h, size)
    T = np.concatenate(
        [
            temperature.temperature_degC[temperature.between(p.start_s[0], p.end_s[-1])]
            for p in places
        ]
    )
    span = float(np.ptp(T, axis=0).min())
    noise = float(max(white_noise(p, twin)[0].max() for p in places)) / np.sqrt(MIN_PARKED_S / HOUR)
    of_heading = 2.0 * earth * np.cos(run.header.site.lat_rad) if len(places) > 1 else 0.0
    change = (
        float(np.ptp(rates, axis=0).max())
        - 4.0 * (noise + twin.gyro.bias_instability_deg_h)
        - of_heading
    )
    allowed = np.sqrt(0.3 * 2.0 * -np.expm1(-(max(span, 1.0) ** 2) / (2.0 * 30.0**2)))
    return max(least_deg_h, size, change / allowed)


def _minutes(seconds: ParkedSeconds) -> list[tuple[ParkedSeconds, float, float]]:
    """A stretch in equal parts of a minute or more."""
    start, end = float(seconds.start_s[0]), float(seconds.end_s[-1])
    edges = np.linspace(start, end, max(int((end - start) / MIN_PARKED_S), 1) + 1)
    return [(seconds, float(a), float(b)) for a, b in pairwise(edges)]
