"""What a session would look like if something taken for granted were wrong: latitude, clock, a
scale, an axis, a gyro that steps, or whose bias follows its temperature late.

Such a fact changes every bin's bias by a known pattern times an unknown size. The chi-square of a
whole session (some 48 degrees of freedom) hardly feels one pattern; along the pattern itself its
size and sigma come in closed form from what the filter learnt. With the bins' prior N(0, C) and
posterior N(m, P), the evidence about b -> b + s x is::

    g = C^-1 m,   M = C^-1 - C^-1 P C^-1,   x = s'g / s'M s,   sigma_x = 1 / sqrt(s'M s)

(information form; Bar-Shalom (2001), section 5.2). A session that resembles a wrong fact beyond the
99.9 % bound is not merged. One that resembles it beyond the 98 % bound is merged with that pattern
as one more uncertainty of its own: the table is taught nothing along it.

Decision: docs/decisions/0016-contradicting-sessions.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from alignment.linearised import mean_attitudes
from infield.session.bins import SessionBins
from infield.session.estimate import SessionEstimate
from infield.session.log import compensated_seconds
from infield.session.reasons import SessionReason, WrongFact
from infield.table.merge import CONFIDENCE, UNOBSERVED
from infield.table.thermal_table import ThermalTable
from ins.earth import gravity_magnitude, omega_ie_n, omega_ie_n_by_lat
from ins.errors.catalogue import prior
from ins.records import AXES, Run, Site, TwinModel
from ins.robust import chi2, norm
from ins.units import DEG, DEG_PER_HOUR, MICRO_G, MILLIRADIAN, STANDARD_GRAVITY
from ins.verdicts import Reason, because

# of sound sessions that any pattern of one kind may widen: the quiet ones are to lose nothing
WIDENED_SHARE = 0.02
# The same of a bias that lags behind its temperature: a trait of the unit, which convicts nobody.
# Of 20 sessions with 0.0024 deg/h per degC and 600 s on one gyro, warming by up to 60 degC, those
# whose table was 3 to 4.7 sigma wrong showed 2.1 to 4.6 sigma of it
LAGGING_SHARE = 0.05
LAG_S = 600.0  # of it: patterns of 300 and 1800 s are like that of 600 s
# of a pattern's information had the session seen every bias without noise: below, what is left is
# the rounding of a direction that the session does not show (gyros turned about the vertical of a
# vehicle that never moves, which came out by 17 rad); chosen: 1 %
SHOWN_SHARE = 0.01
MOST_WIDENED = 3  # patterns that one session may be widened along; the ninth adds nothing new
# What a bias may do with temperature, of which no step is told: a slope of 0.003 deg/h per degC
# and 0.02 deg/h per degC/min, five times the factory curves' slope and the usual rate term
FREE_SLOPE, FREE_RATE = 0.003, 0.02

# Of the specific force at rest against gravity [micro-g]: normal gravity leaves out anomalies of
# some 50 mGal, a height entered above the geoid instead of the ellipsoid is 50 m off (15 micro-g),
# and the scale of an accelerometer repeats (ins.errors), 1 ppm of which is 1 micro-g at rest
ANOMALY_ug, HEIGHT_ug = 50.0, 15.0
# what is not Gaussian in these: no sound unit lies beyond (6e-7 of Gaussian errors)
FORCE_SIGMAS = 5.0

# Of a log that says which table it had subtracted, by how much likelier it must be that it had for
# the statement to be believed whole: a thousand to one; and that it had not, to be convicted: 20
# to 1, the error of a hurried hand being one in a hundred. Of one that says it is raw, as most are,
# 20 to 1 either way: at most 0.7 % of compensated ones are believed, whatever their table's size
BELIEVED_NATS, CONVICTED_NATS = float(np.log(1000.0)), float(np.log(20.0))


@dataclass(frozen=True)
class Suspicion:
    """A wrong fact that a session resembles: its size and sigma in the fact's own unit.

    axis: of the gyro, "" where the fact concerns all; at_s: when a gyro steps, NaN for the rest;
    pattern (3N,): change of the bins' biases [deg/h] per unit; limit_sigmas: of one sound session
    in a thousand; convicts: the session is not merged.
    """

    fact: WrongFact
    axis: str
    at_s: float
    size: float
    sigma: float
    limit_sigmas: float
    convicts: bool
    pattern: NDArray

    @property
    def sigmas(self) -> float:
        return self.size / self.sigma

    @property
    def reason(self) -> Reason:
        return because(
            SessionReason.LIKE_A_WRONG_FACT,
            fact=self.fact,
            axis=self.axis,
            at_s=self.at_s,
            size=self.size,
            sigma=self.sigma,
            sigmas=self.sigmas,
            limit_sigmas=self.limit_sigmas,
        )


@dataclass(frozen=True)
class SessionInformation:
    """What a session learnt of its bins' biases beyond the table: prior (3N, 3N), posterior mean
    (3N,) and covariance (3N, 3N) [deg/h].
    """

    prior: NDArray
    mean: NDArray
    covariance: NDArray

    def evidence(self) -> tuple[NDArray, NDArray]:
        """g (3N,) and M (3N, 3N) of this module's head."""
        inverse = np.linalg.inv(self.prior)
        return inverse @ self.mean, inverse - inverse @ self.covariance @ inverse

    def explained_by(self, pattern: NDArray) -> bool:
        """Whether, less a pattern (3N,), the biases are within CONFIDENCE of what was expected."""
        g, M = self.evidence()
        L = np.linalg.cholesky(self.prior)
        shares, V = np.linalg.eigh(L.T @ M @ L)
        seen = shares > UNOBSERVED
        left = V[:, seen].T @ (L.T @ (g - M @ pattern))
        nis = float(np.sum(left**2 / shares[seen]))
        return nis <= float(chi2.ppf(CONFIDENCE, np.count_nonzero(seen)))

    def widened(self, doubt: NDArray) -> "SessionInformation":
        """The same measurements under a prior that is wider by `doubt` (3N, 3N)."""
        before = np.linalg.inv(self.prior)
        after = np.linalg.inv(self.covariance)
        prior = self.prior + doubt
        covariance = np.linalg.inv(after - before + np.linalg.inv(prior))
        covariance = 0.5 * (covariance + covariance.T)
        return SessionInformation(prior, covariance @ (after @ self.mean), covariance)


@dataclass(frozen=True)
class _Pattern:
    """What a fact of size 1 does to the bins (N, 3) [deg/h]."""

    fact: WrongFact
    axis: str
    at_s: float
    bias_deg_h: NDArray


def learnt_of(estimate: SessionEstimate) -> SessionInformation:
    """What a session's estimate says of its bins."""
    return SessionInformation(estimate.bins.prior, estimate.mean_deg_h, estimate.covariance)


def suspicions(
    estimate: SessionEstimate, learnt: SessionInformation | None = None
) -> tuple[Suspicion, ...]:
    """The wrong facts that a navigated session resembles beyond chance, the clearest first.

    learnt: of the same bins where more is known of them than the estimate did (a rate term).
    A unit that finds no heading is not asked: its level and Earth rate are free already.
    """
    if estimate.solution is None:
        return ()
    learnt = learnt or learnt_of(estimate)
    of_temperature = learnt.widened(_of_temperature(estimate.bins))
    lagging = _beyond_chance(_lags(estimate.bins), learnt, learnt, LAGGING_SHARE)
    found = [
        *_beyond_chance(_of_earth_rate(estimate), learnt, learnt),
        *_beyond_chance(_steps(estimate.bins), learnt, of_temperature),
        *(replace(lag, convicts=False) for lag in lagging),
    ]
    return tuple(sorted(found, key=_clearest))


def _clearest(suspicion: Suspicion) -> tuple[bool, float]:
    return not suspicion.convicts, -abs(suspicion.sigmas) / suspicion.limit_sigmas


def force_off_gravity(run: Run, twin: TwinModel, estimate: SessionEstimate) -> Reason | None:
    """A reason where the specific force at rest is not gravity: a clock that runs wrong by a
    thousandth changes it by 1,000 micro-g, and Earth rate by 0.015 deg/h; None where it is,
    or where the log begins in motion.
    """
    if estimate.solution is None or estimate.begun is not None:
        return None
    parked = float(estimate.solution.history.time_s[0]), estimate.alignment.time_s
    seconds = compensated_seconds(run, None, None, twin).between(*parked)
    if not seconds.end_s.size:
        return None
    blocks = seconds.blocks()
    force = np.linalg.norm(blocks.dv_m_s / blocks.seconds[:, None], axis=1)
    site = run.header.site
    gravity = float(gravity_magnitude(site.lat_rad, site.height_m))
    excess_ug = float(np.median(force) - gravity) / MICRO_G
    scale_ug = prior("accel_scale_factor", "session").each()[run.header.gyro_technology]
    sigma_ug = float(np.linalg.norm([twin.accel.turn_on_ug, ANOMALY_ug, HEIGHT_ug, scale_ug]))
    if abs(excess_ug) <= FORCE_SIGMAS * sigma_ug:
        return None
    return because(
        SessionReason.FORCE_OFF_GRAVITY,
        excess_ug=excess_ug,
        limit_ug=FORCE_SIGMAS * sigma_ug,
        share_percent=100.0 * excess_ug * MICRO_G / STANDARD_GRAVITY,
    )


def with_suspicions(estimate: SessionEstimate) -> tuple[SessionEstimate, tuple[Suspicion, ...]]:
    """The estimate with what it resembles, but not beyond doubt, among its own uncertainties; and
    what that is.

    To be asked of a session that agrees with the table as it stands: a gyro that stepped before the
    session, and warms up in it, resembles one that lags or steps within, and a doubt would hide it.
    A convicted session comes back as it is: nothing of it is merged.
    """
    doubted: list[Suspicion] = []
    for _ in range(MOST_WIDENED):
        found = suspicions(estimate)
        if not found or found[0].convicts:
            break
        doubted.append(found[0])
        estimate = widened_by(estimate, *_doubts(found[0]))
    return estimate, tuple(doubted)


def doubtful_compensation(
    estimate: SessionEstimate, stored: ThermalTable | None, applied: ThermalTable | None
) -> Suspicion | None:
    """A log that says it had a table subtracted, and may not have: then that table stands in its
    biases as a whole. Or one that says it is raw, and may be compensated: then the stored table is
    missing from them. None where the log is to be believed, or the table is zero; a unit that finds
    no heading is not asked, nor a raw log without a stored table to weigh it against.

    The size of the pattern is known, so the two are weighed against each other: size 1 (it says
    wrongly) against 0 (as it says). None where it would not explain the session: a gyro that
    stepped may happen to resemble the table, and has to be remembered as a step.
    """
    fact, sign, table, believed_nats = WrongFact.COMPENSATION, 1.0, applied, BELIEVED_NATS
    if table is None:
        fact, sign, table = WrongFact.COMPENSATED_BEFORE, -1.0, stored
        believed_nats = CONVICTED_NATS
    if estimate.solution is None or table is None:
        return None
    T = estimate.bins.temperature_degC
    pattern = sign * table.extended_to(float(T.min()), float(T.max())).settled_deg_h(T)
    learnt = learnt_of(estimate)
    size, sigma = _sizes(pattern.reshape(1, -1), learnt)
    against_it_nats = float((2.0 * size[0] - 1.0) / (2.0 * sigma[0] ** 2))
    believed = against_it_nats < -believed_nats or not pattern.any()
    if believed or not learnt.explained_by(pattern.ravel()):
        return None
    return Suspicion(
        fact=fact,
        axis="",
        at_s=float("nan"),
        size=float(size[0]),
        sigma=float(sigma[0]),
        limit_sigmas=float(np.sqrt(2.0 * believed_nats)),
        convicts=against_it_nats > CONVICTED_NATS,
        pattern=pattern.ravel(),
    )


def _doubts(suspicion: Suspicion) -> tuple[NDArray, ...]:
    """The patterns (3N,) [deg/h] that a suspicion adds to a session's uncertainties."""
    late = suspicion.size * suspicion.pattern
    if suspicion.fact is not WrongFact.GYRO_STEP:
        return (late,)
    early = np.zeros_like(late)
    of_axis = slice(AXES.index(suspicion.axis), None, len(AXES))
    early[of_axis] = suspicion.size - late[of_axis]
    return late / np.sqrt(2.0), early / np.sqrt(2.0)


def widened_by(estimate: SessionEstimate, *patterns: NDArray) -> SessionEstimate:
    """The estimate with patterns (3N,) [deg/h], 1 sigma each, among its own uncertainties."""
    S = np.array(patterns)
    return _with_doubt_of(estimate, S.T @ S)


def _with_doubt_of(estimate: SessionEstimate, doubt: NDArray) -> SessionEstimate:
    """The estimate under a prior that is wider by `doubt` (3N, 3N)."""
    learnt = learnt_of(estimate).widened(doubt)
    return replace(
        estimate,
        bins=estimate.bins.doubted(doubt),
        mean_deg_h=learnt.mean,
        covariance=learnt.covariance,
    )


def without_lag(estimate: SessionEstimate, doubted: Sequence[Suspicion]) -> SessionEstimate:
    """The estimate without what it was widened by for a lag behind temperature: several sessions
    together show whether it is a term of the unit.
    """
    lags = [s.size * s.pattern for s in doubted if s.fact is WrongFact.THERMAL_LAG]
    if not lags:
        return estimate
    S = np.array(lags)
    return _with_doubt_of(estimate, -S.T @ S)


def _beyond_chance(
    patterns: Sequence[_Pattern],
    learnt: SessionInformation,
    on_trial: SessionInformation,
    widened_share: float = WIDENED_SHARE,
) -> list[Suspicion]:
    """Those of one kind of patterns that more than the share of sound sessions resemble.

    on_trial: under the prior that a conviction needs, where other causes look alike.
    """
    if not patterns:
        return []
    S = np.array([p.bias_deg_h.ravel() for p in patterns])
    size, sigma = _sizes(S, learnt)
    tried, sigma_tried = _sizes(S, on_trial)
    worth = norm.isf(widened_share / 2.0 / len(patterns))
    limit = float(norm.isf((1.0 - CONFIDENCE) / 2.0 / len(patterns)))
    convicts = np.abs(tried) > limit * sigma_tried
    return [
        Suspicion(
            p.fact, p.axis, p.at_s, float(size[k]), float(sigma[k]), limit, bool(convicts[k]), S[k]
        )
        for k, p in enumerate(patterns)
        if convicts[k] or abs(size[k]) > worth * sigma[k]
    ]


def _sizes(S: NDArray, learnt: SessionInformation) -> tuple[NDArray, NDArray]:
    """Size and sigma (K,) of patterns (K, 3N), each alone; sigma is inf where nothing shows."""
    g, M = learnt.evidence()
    information = np.einsum("ki,ij,kj->k", S, M, S)
    most = np.einsum("ki,ij,kj->k", S, np.linalg.inv(learnt.prior), S)
    shown = information > SHOWN_SHARE * most
    size = np.divide(S @ g, information, out=np.zeros(len(S)), where=shown)
    return size, np.sqrt(np.divide(1.0, information, out=np.full(len(S), np.inf), where=shown))


def _of_earth_rate(estimate: SessionEstimate) -> list[_Pattern]:
    """Facts that change how Earth rate is taken out of the gyros, on the headings of this session.

    A latitude wrong by dL (computed less true) leaves -d(omega)/dL of Earth rate in the gyros; a
    clock that runs fast by a share leaves that share of it missing.
    """
    bins, history = estimate.bins, estimate.navigated.history
    C_bn = mean_attitudes(history, bins.start_s, bins.end_s)
    earth_b = C_bn @ omega_ie_n(history.lat_rad[0]) / DEG_PER_HOUR
    nan = float("nan")
    patterns = [
        _Pattern(WrongFact.LATITUDE, "", nan, _by_latitude(estimate)),
        _Pattern(WrongFact.TIME_BASE, "", nan, -earth_b),
    ]
    for k, axis in enumerate(AXES):
        unit = np.eye(3)[k]
        patterns.append(_Pattern(WrongFact.GYRO_SCALE, axis, nan, earth_b * unit))
        turned = -MILLIRADIAN * np.cross(unit, earth_b)
        patterns.append(_Pattern(WrongFact.GYRO_AXES, axis, nan, turned))
    return patterns


def _by_latitude(estimate: SessionEstimate) -> NDArray:
    """What a latitude wrong by 1 deg does to the bins (N, 3) [deg/h]."""
    bins, history = estimate.bins, estimate.navigated.history
    C_bn = mean_attitudes(history, bins.start_s, bins.end_s)
    return np.asarray(-DEG * (C_bn @ omega_ie_n_by_lat(history.lat_rad[0])) / DEG_PER_HOUR)


def widened_for_place(estimate: SessionEstimate, site: Site, sessions: int) -> SessionEstimate:
    """The estimate among `sessions` of an update at one place, which have the error of its latitude
    in common: with that many times its variance in each, and nothing in common, what they all teach
    is never surer than one such error leaves it (|sum|^2 <= n sum of squares, as in
    `infield.session.parked.earth`).
    """
    if estimate.solution is None or sessions < 2:
        return estimate
    more_deg = np.sqrt(sessions - 1) * site.sigma_lat_rad / DEG
    return widened_by(estimate, more_deg * _by_latitude(estimate).ravel())


def widened_for_own_errors(estimate: SessionEstimate, sessions: int) -> SessionEstimate:
    """The estimate among `sessions` of an update that have a user's errors in common: likewise."""
    if estimate.own is None or sessions < 2 or not estimate.own.in_common:
        return estimate
    return widened_by(estimate, *np.sqrt(sessions - 1) * np.array(estimate.own.in_common))


def _steps(bins: SessionBins) -> list[_Pattern]:
    """A gyro's bias that steps between two bins."""
    patterns = []
    for k, axis in enumerate(AXES):
        for later in range(1, len(bins.centre_s)):
            step = np.zeros((len(bins.centre_s), 3))
            step[later:, k] = 1.0
            at_s = float(bins.start_s[later])
            patterns.append(_Pattern(WrongFact.GYRO_STEP, axis, at_s, step))
    return patterns


def _lags(bins: SessionBins) -> list[_Pattern]:
    """A gyro's bias that follows its temperature through a first-order lag."""
    T, time_s = bins.temperature_degC, bins.centre_s
    behind = np.zeros_like(T)
    keep = np.exp((bins.start_s[0] - time_s[0]) / LAG_S)
    behind[0] = -(1.0 - keep) * bins.rate_degC_min[0] / 60.0 * LAG_S
    for k in range(1, len(T)):
        step_s = time_s[k] - time_s[k - 1]
        keep = np.exp(-step_s / LAG_S)
        # of a ramp from bin to bin, exactly
        ramp = (T[k] - T[k - 1]) / step_s * LAG_S
        behind[k] = keep * behind[k - 1] - (1.0 - keep) * ramp
    nan = float("nan")
    return [
        _Pattern(WrongFact.THERMAL_LAG, axis, nan, behind * np.eye(3)[k])
        for k, axis in enumerate(AXES)
    ]


def _of_temperature(bins: SessionBins) -> NDArray:
    """Covariance (3N, 3N) [(deg/h)^2] of a bias that is any line of temperature and of its rate."""
    count = len(bins.centre_s)
    covariance = np.zeros((3 * count, 3 * count))
    for k in range(3):
        T = bins.temperature_degC[:, k] - bins.temperature_degC[:, k].mean()
        slope, rate = FREE_SLOPE * T, FREE_RATE * bins.rate_degC_min[:, k]
        covariance[k::3, k::3] = np.outer(slope, slope) + np.outer(rate, rate)
    return covariance
