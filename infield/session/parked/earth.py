"""Earth rate in the body axes of a unit that stands on unknown headings, over all stretches of a
log::

    e_s = Omega cosL (f_s cosH_s - r_s sinH_s) - Omega sinL d_s

with f, r, d the forward, right and down axes of the levelled unit. The vertical part is known by
gravity. The level part of a stretch is one error of all its points, mean 0, variance (Omega cosL)^2
/ 2 on either level axis. Between stretches the headings differ by turns D that the gyros give::

    E[e_s e_t'] = (Omega cosL)^2 / 2 exp(-var(D) / 2)
                  (cosD (f_s f_t' + r_s r_t') - sinD (f_s r_t' - r_s f_t'))

which is one error where the unit was not turned (D = 0), the opposite one after half a turn, none
in common after an unknown one. Where the gyros do not say how far it turned, an unknown heading and
an unchanged one are both possible and no one covariance fits both: each of G such groups of
stretches takes G times its variance and nothing in common, which is at least as large as any
relation of their headings (sum of G vectors, |sum|^2 <= G sum of squares). Units: deg/h. Source:
[derived]; the bound: Julier and Uhlmann, American Control Conference (1997), covariance
intersection.

Decision: docs/decisions/0032-no-heading-no-navigation.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.motion.parked_seconds import ParkedSeconds
from alignment.motion.turn_between import HeadingChange, levelled
from infield.session.estimate import SessionEarth
from infield.session.settings import SessionSettings
from ins.attitude import dcm_from_euler, level_angles
from ins.earth import EARTH_RATE_RAD_S, gravity_magnitude
from ins.estimation.measurements.gravity import rest_readings
from ins.records import Run, Site, TwinModel
from ins.units import DEG_PER_HOUR, MICRO_G, PPM


@dataclass(frozen=True)
class StretchEarth:
    """One stretch: known part of Earth rate (3,), covariance of the rest (3, 3) [deg/h], what of it
    the heading makes (1 sigma on a level axis), down (3,) in body axes, the tilt error [rad], and
    what 1 sigma of the latitude leaves of Earth rate (3,) [deg/h], as far as the heading is known.
    """

    known: NDArray
    covariance: NDArray
    heading_deg_h: float
    down_b: NDArray
    tilt_rad: float
    by_latitude: NDArray


@dataclass(frozen=True)
class _Place:
    """A stretch by its group of linked headings, its heading less the group's first and the
    variance of that.
    """

    group: int
    heading_rad: float
    variance_rad2: float


def stretch_earth(
    run: Run,
    seconds: ParkedSeconds,
    twin: TwinModel,
    settings: SessionSettings,
    heading: tuple[float, float] | None,
) -> StretchEarth:
    """Earth rate of one stretch; heading: its heading and sigma [rad], where known."""
    site = run.header.site
    f_b = seconds.means(-np.inf, np.inf)[0][:3]
    down = -f_b / np.linalg.norm(f_b)
    level = np.eye(3) - np.outer(down, down)
    gravity = float(gravity_magnitude(site.lat_rad, site.height_m))
    tilt = np.hypot(twin.accel.turn_on_ug * MICRO_G, abs(np.linalg.norm(f_b) - gravity)) / gravity
    north, up = _north_up(site)
    scale = (
        EARTH_RATE_RAD_S
        / DEG_PER_HOUR
        * settings.sigma_scale_factor_ppm[run.header.gyro_technology]
        * PPM
    )
    covariance = (
        (up * tilt) ** 2 * level + (north * tilt) ** 2 * np.outer(down, down) + scale**2 * np.eye(3)
    )
    if heading is None:
        sigma = float(north / np.sqrt(2.0))
        return StretchEarth(
            -up * down,
            covariance + 0.5 * north**2 * level,
            sigma,
            down,
            float(tilt),
            -north * site.sigma_lat_rad * down,
        )
    C_nb = dcm_from_euler(*level_angles(f_b), heading[0])
    earth = rest_readings(C_nb, lat_rad=site.lat_rad, height_m=site.height_m)
    by_heading = heading[1] * earth.rate_of_phi[:, 2] / DEG_PER_HOUR
    return StretchEarth(
        earth.rate / DEG_PER_HOUR,
        covariance + np.outer(by_heading, by_heading),
        0.0,
        down,
        float(tilt),
        site.sigma_lat_rad * earth.rate_of_latitude / DEG_PER_HOUR,
    )


def session_earth(
    run: Run,
    places: Sequence[ParkedSeconds],
    turns: Sequence[HeadingChange],
    twin: TwinModel,
    settings: SessionSettings,
    *,
    survey: tuple[float, float] | None,
) -> SessionEarth:
    """Earth rate of all stretches; turns (S - 1) between them; survey: heading and sigma [rad] of
    the first one.
    """
    linked = _linked(turns)
    headings = [
        (
            None
            if survey is None or p.group
            else (survey[0] + p.heading_rad, float(np.hypot(survey[1], np.sqrt(p.variance_rad2))))
        )
        for p in linked
    ]
    earth = [stretch_earth(run, s, twin, settings, h) for s, h in zip(places, headings)]
    north, up = _north_up(run.header.site)
    scale = (
        EARTH_RATE_RAD_S
        / DEG_PER_HOUR
        * settings.sigma_scale_factor_ppm[run.header.gyro_technology]
        * PPM
    )
    groups = max(len({p.group for p, h in zip(linked, headings) if h is None}), 1)
    count = len(places)
    C, of_heading = np.zeros((2, 3 * count, 3 * count))
    for s in range(count):
        own = slice(3 * s, 3 * s + 3)
        level = np.eye(3) - np.outer(earth[s].down_b, earth[s].down_b)
        C[own, own] = earth[s].covariance + (groups - 1) * earth[s].heading_deg_h ** 2 * level
        of_heading[own, own] = groups * earth[s].heading_deg_h ** 2 * level
        for t in range(s):
            other = slice(3 * t, 3 * t + 3)
            block, part = (
                _common(earth[s], earth[t], north, up) + scale**2 * np.eye(3),
                np.zeros((3, 3)),
            )
            if linked[s].group == linked[t].group:
                frames = levelled(places[s]), levelled(places[t])
                part = north**2 * _heading_part(linked[s], linked[t], *frames, headings[t], groups)
            C[own, other], C[other, own] = block + part, (block + part).T
            if headings[s] is None:
                of_heading[own, other], of_heading[other, own] = part, part.T
    by_latitude = np.concatenate([e.by_latitude for e in earth])
    return SessionEarth(
        np.stack([e.known for e in earth]),
        C + np.outer(by_latitude, by_latitude),
        of_heading,
        np.array([e.heading_deg_h * np.sqrt(groups) for e in earth]),
        np.stack([e.down_b for e in earth]),
    )


def _linked(turns: Sequence[HeadingChange]) -> list[_Place]:
    """A new group of headings begins where a turn is not told."""
    found = [_Place(0, 0.0, 0.0)]
    for turn in turns:
        last = found[-1]
        if not turn.told:
            found.append(_Place(last.group + 1, 0.0, 0.0))
        else:
            found.append(
                _Place(
                    last.group,
                    last.heading_rad + turn.heading_rad,
                    last.variance_rad2 + turn.sigma_rad**2,
                )
            )
    return found


def _common(one: StretchEarth, other: StretchEarth, north: float, up: float) -> NDArray:
    """What the accelerometers' own bias, the same all along, makes in two stretches (3, 3)."""
    level = [np.eye(3) - np.outer(e.down_b, e.down_b) for e in (one, other)]
    both = one.tilt_rad * other.tilt_rad
    return np.asarray(
        both * (up**2 * level[0] @ level[1] + north**2 * np.outer(one.down_b, other.down_b))
    )


def _heading_part(
    later: _Place,
    earlier: _Place,
    frame: NDArray,
    frame0: NDArray,
    heading: tuple[float, float] | None,
    groups: int,
) -> NDArray:
    """E[e e'] of the level parts of two linked stretches (3, 3), over (Omega cosL)^2."""
    turn, variance = (
        later.heading_rad - earlier.heading_rad,
        later.variance_rad2 - earlier.variance_rad2,
    )
    if heading is not None:
        H1, H0 = heading[0] + turn, heading[0]
        east, east0 = (C[0] * np.sin(H) + C[1] * np.cos(H) for C, H in ((frame, H1), (frame0, H0)))
        return np.asarray(heading[1] ** 2 * np.outer(east, east0))
    (f, r), (f0, r0) = frame[:2], frame0[:2]
    same = np.outer(f, f0) + np.outer(r, r0)
    across = np.outer(r, f0) - np.outer(f, r0)
    return np.asarray(
        0.5 * groups * np.exp(-0.5 * variance) * (np.cos(turn) * same - np.sin(turn) * across)
    )


def _north_up(site: Site) -> tuple[float, float]:
    omega = EARTH_RATE_RAD_S / DEG_PER_HOUR
    return float(omega * np.cos(site.lat_rad)), float(omega * np.sin(site.lat_rad))
