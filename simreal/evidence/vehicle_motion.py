"""A parked vehicle that people, wind and loads move: its turns are taken out of a run's readings.

The gyros see every turn, as in an update. What they read is integrated back from the end of the
parked stretch, and the specific force is turned to where the vehicle stands there::

    f'(t) = f(t) + S int_t^T w dt,   S = d f / d (turn of the body)

So an error of a level gyro shows in the specific force alone, and the gyro's own rows, which are
the vehicle's, say nothing. What is left of the motion is how the place of the unit and its heading
stray: a velocity and an angle without mean. Their level is read off differences of neighbouring
means, five minutes at a time, as `alignment.level_fit` reads it off innovations.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d

from ins.attitude import dcm_from_rotation_vector, skew
from ins.earth import gravity_magnitude, omega_ie_n
from ins.records import ImuSource, Site
from simreal.evidence.noise_model import ChannelNoise
from simreal.evidence.seconds import Seconds

BIN_S = 10.0
WINDOW = 30  # bins of one level: people board for a quarter of an hour
LONG = 6  # bins of the means that tell a walk of the heading from its jitter
# an event (a door, a blow, an engine's thrust) stands out of the median of a minute so far: of
# Gaussian means 6e-5 do
STRAY_SIGMA, NEAR = 4.0, 7
# of an axis, by the cosine of its lean: within 30 deg of the vertical it is no level one
UPRIGHT = float(np.cos(np.radians(30.0)))
LEVELLINGS = 4
CHI2_MEDIAN = 0.4549  # of one degree of freedom


@dataclass(frozen=True)
class VehicleMotion:
    """level (3,): the body axes whose gyros read the vehicle. force_of_turn (3, 3): S [m/s^2/rad].

    jitter (6, bins): variance of the angle [rad^2] and of the velocity [m^2/s^2] without mean;
    white (6, bins): of a mean, by a walk of the heading and single events.
    """

    level: NDArray
    force_of_turn: NDArray
    jitter: NDArray
    white: NDArray

    def covariance(self, channel: int) -> NDArray:
        """What straying adds to a channel's means (bins, bins)."""
        s = self.jitter[channel]
        ends = np.concatenate([s[:1], s])
        C = np.diag(ends[1:] + ends[:-1])
        C -= np.diag(ends[1:-1], 1) + np.diag(ends[1:-1], -1)
        return C / BIN_S**2 + np.diag(self.white[channel])

    @property
    def sway_m_s(self) -> float:
        """RMS of the level velocity at the end."""
        return float(np.sqrt(self.jitter[3:, -WINDOW:][self.level].mean()))

    @property
    def yaw_rad(self) -> float:
        """RMS of the heading about its place."""
        return float(np.sqrt(self.jitter[:3][~self.level].mean()))


def to_the_end(bins: int) -> NDArray:
    """Takes means of a rate to means of its integral from there to the end (bins, bins) [s]."""
    return BIN_S * (np.triu(np.ones((bins, bins)), 1) + 0.5 * np.eye(bins))


def bends_of(imu: ImuSource, end_s: NDArray) -> NDArray:
    """How far the mean attitude of each second lies beyond half of the second's turn (n, 3) [rad].

    A vehicle that rocks at a hertz turns back within the second: half turns alone would read its
    rocking as a slow tilt, 40 micro-g on an airliner that rolls at 1.1 Hz in a gusty wind.
    """
    count, begin_s = end_s.size, float(end_s[0]) - 1.0
    out = np.zeros((count, 3))
    for rows in imu.pieces(begin_s, float(end_s[-1])):
        middle_s = rows.time_s - 0.5 * rows.dt_s - begin_s
        second = np.clip(np.floor(middle_s).astype(int), 0, count - 1)
        left_s = second + 1.0 - middle_s
        for axis in range(3):
            weighed = (left_s - 0.5) * rows.dtheta_rad[:, axis]
            out[:, axis] += np.bincount(second, weighed, minlength=count)
    return out


def turned_back(
    seconds: Seconds,
    span: tuple[float, float],
    C_nb: NDArray,
    site: Site,
    *,
    finds_north: bool,
    bends: NDArray | None = None,
) -> tuple[Seconds, NDArray]:
    """The seconds as if the vehicle had stood as it stands at the end of the span, and its attitude
    there (3, 3): level and, where the unit finds_north, heading are those under which the force is
    level all the time. A mean of the gyros is off by the turns of the vehicle: of 0.4 deg of
    heading, 0.05 deg of level are made in an hour, which are 0.01 deg/h of Earth rate.

    C_nb : about the attitude at the end. bends : of each second (`bends_of`); None: none.
    """
    inside = np.flatnonzero((seconds.end_s > span[0] + 1e-6) & (seconds.end_s <= span[1] + 1e-6))
    rate, force = seconds.mean[inside, :3], seconds.mean[inside, 3:]
    earth_n = omega_ie_n(site.lat_rad)
    to_end = 0.5 * rate if bends is None else 0.5 * rate - bends[inside]
    half, whole = dcm_from_rotation_vector(to_end), dcm_from_rotation_vector(rate)
    later = np.empty_like(half)  # takes what is fixed at the end into the body's mean of a second
    onward = np.eye(3)
    for k in range(len(inside) - 1, -1, -1):
        later[k] = half[k] @ onward
        onward = whole[k] @ onward
    to_end_s = seconds.end_s[inside[-1]] - seconds.end_s[inside] + 0.5
    turned = dcm_from_rotation_vector(to_end_s[:, None] * earth_n)
    g = float(gravity_magnitude(site.lat_rad, site.height_m))

    def attitudes() -> NDArray:
        return np.asarray(turned @ C_nb @ later.transpose(0, 2, 1))

    for _ in range(LEVELLINGS):
        force_n = np.einsum("kij,kj->ki", attitudes(), force)
        (slope, _), (north, east) = np.polyfit(to_end_s, force_n[:, :2], 1)
        # a heading error psi turns the level by psi Omega cosL in a second
        psi = float(slope / (g * earth_n[0])) if finds_north else 0.0
        C_nb = dcm_from_rotation_vector(np.array([-east / g, north / g, -psi])) @ C_nb
    of_middle = attitudes()
    mean = seconds.mean.copy()
    mean[inside, 3:] = np.einsum("kij,kj->ki", of_middle, force) @ C_nb
    mean[inside, :3] = rate - earth_n @ of_middle + earth_n @ C_nb
    return replace(seconds, mean=mean), C_nb


def level_axes(C_nb: NDArray) -> NDArray | None:
    """Which body axes are level (3,); None where none is upright."""
    upright = np.abs(C_nb[2])
    return None if upright.max() < UPRIGHT else np.arange(3) != np.argmax(upright)


def motion_of(
    means: NDArray,
    C_nb: NDArray,
    site: Site,
    noises: tuple[ChannelNoise, ...],
    *,
    turned: bool = True,
) -> VehicleMotion:
    """How the vehicle strays, from ten-second means (6, bins) that are turned back.

    turned : false of a unit that finds no north, whose gyros are too noisy to turn anything back:
        what the vehicle does is then noise of all sensors, with a mean where a level leans.
    """
    level = level_axes(C_nb)
    assert level is not None
    jitter, white = np.zeros((2, *means.shape))
    up = int(np.flatnonzero(~level)[0])
    for c in (up, 3, 4, 5) if turned else range(6):
        (square, own), walk = _differences(means[c], noises[c], 1), 0.0
        if c == up or not turned:
            # differences of means over n bins: 6 s / (10 n)^2 + 2 q / (10 n)
            typical = [_typical(means[c], noises[c], n) for n in (1, LONG)]
            beyond = typical[1] - typical[0] / LONG**2
            walk = 0.5 * max(beyond, 0.0) * LONG / (1.0 - 1.0 / LONG)
        level_of = uniform_filter1d(square, WINDOW, mode="nearest") - own - 2.0 * walk
        jitter[c, 1:] = np.maximum(level_of, 0.0) / (6.0 / BIN_S**2)
        jitter[c, 0] = jitter[c, 1]
        quiet = noises[c].covariance(1, BIN_S)[0, 0] + 2.0 * jitter[c] / BIN_S**2 + walk
        stray = (means[c] - median_filter(means[c], NEAR, mode="nearest")) ** 2
        white[c] = walk + np.where(stray > STRAY_SIGMA**2 * quiet, stray, 0.0)
    g = float(gravity_magnitude(site.lat_rad, site.height_m))
    force_of_turn = skew(C_nb.T @ np.array([0.0, 0.0, -g]))
    if not turned:
        level, force_of_turn = np.zeros(3, bool), np.zeros((3, 3))
    return VehicleMotion(level, force_of_turn, jitter, white)


def _differences(means: NDArray, noise: ChannelNoise, bins: int) -> tuple[NDArray, float]:
    """Squared differences of neighbouring means over so many bins, and their size by the noise."""
    whole = means[: means.size // bins * bins].reshape(-1, bins).mean(axis=1)
    C = noise.covariance(2, BIN_S * bins)
    return np.diff(whole) ** 2, 2.0 * float(C[0, 0] - C[0, 1])


def _typical(means: NDArray, noise: ChannelNoise, bins: int) -> float:
    """Such a square beyond the noise, single events apart."""
    square, own = _differences(means, noise, bins)
    return float(np.median(square)) / CHI2_MEDIAN - own if square.size else 0.0
