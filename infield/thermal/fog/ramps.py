"""Fibre-optic gyro: temperature coefficient K_T(T) and rate coefficient K_delta(T) from chamber
ramps (CN 106017511)::

    b(T, dT/dt) = K_T(T) + K_delta(T) dT/dt

with b in deg/h, dT/dt in degC/min, K_delta in deg/h per degC/min. Three ways:
`document_subtraction` as the document has it, which leaves K_delta times the slow rate inside K_T;
`exact_separation`, two equations in two unknowns; `up_down`, the fast pair alone. The estimate is
the exact separation as a least-squares fit over all blocks, each with its own rate
(`coefficient_curves`). Source: physics.md section 5.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from infield.thermal.coefficient_curves import Basis, CurveFit, Reduced, fit_rough, smooth_basis
from infield.thermal.ramp_runs import Leg, RampRun
from infield.thermal.reasons import BiasDriver, ThermalNote, ThermalReason
from infield.thermal.study import (
    INFLATE_ABOVE,
    AxisBlocks,
    ThermalStudy,
    axis_blocks,
    contradicted,
    levels_differ,
    moving_base,
    widened,
    with_thermometer,
)
from ins.documents import UNWRITTEN
from ins.records import AXES, TwinModel
from ins.verdicts import Reason, because

H = 2  # the third curve of a fit with hysteresis
# of the pointers; the first is the usual one, the others turn over sooner or later; up to a
# tenth of a chamber's 60 degC
HALF_WIDTHS_degC = (1.5, 0.5, 3.0, 6.0)
# h itself is free, the differences of its widths are as large as the data say
FREE_SIZE = np.diag([0.0, 1.0, 1.0, 1.0])
# sigmas of h from which on a note says so: 0.1 % of gyros without it (3.3)
SHOWN_SIGMAS = 3.3


@dataclass(frozen=True, kw_only=True)
class Hysteresis:
    """The bias warming is not the bias cooling, whatever the rate::

        b = K_T(T) + K_delta(T) dT/dt + h s_0 + sum_j d_j (s_j - s_0),   s from -1 (cooling) to 1

    Each s_j is the play of a pointer dragged along the temperature over 2 w_j (Prandtl, Ishlinskii;
    Visintin (1994), section III.2). h, with its sigma, and the coefficients (4,) of all senses;
    held_apart: the runs tell it from K_delta (two rates, up and down), and it is a term of the fit;
    shown: it is there beyond chance.
    """

    value_deg_h: float
    sigma_deg_h: float
    parts_deg_h: NDArray = field(metadata=UNWRITTEN)
    held_apart: bool
    shown: bool


def no_more_than(sigma_deg_h: float) -> Hysteresis:
    """What runs at one rate leave open."""
    none = np.zeros(len(HALF_WIDTHS_degC))
    return Hysteresis(
        value_deg_h=0.0, sigma_deg_h=sigma_deg_h, parts_deg_h=none, held_apart=False, shown=False
    )


def play(T: NDArray, half_width_degC: float) -> NDArray:
    """s (n,) along temperatures (n,); 0 as they begin."""
    pointer, out = float(T[0]), np.empty(T.size)
    for i, value in enumerate(T.tolist()):
        pointer = min(max(pointer, value - half_width_degC), value + half_width_degC)
        out[i] = (value - pointer) / half_width_degC
    return out


def with_sense(blocks: AxisBlocks, runs: Sequence[RampRun], k: int) -> AxisBlocks:
    """The steady blocks of some runs with the senses of their temperatures, all but the first less
    it.
    """
    senses = [
        np.stack([play(run.temperature_degC[:, k], w) for w in HALF_WIDTHS_degC], axis=1)
        for run in runs
    ]
    for sense in senses:
        sense[:, 1:] -= sense[:, :1]
    steady = [sense[run.steady] for sense, run in zip(senses, runs)]
    return replace(blocks, sense=np.concatenate(steady))


def without(blocks: AxisBlocks, found: Hysteresis) -> AxisBlocks:
    """The blocks less the hysteresis, which is no part of either curve."""
    assert blocks.sense is not None
    return replace(blocks, bias_deg_h=blocks.bias_deg_h - blocks.sense @ found.parts_deg_h)


def each_width(temperature_degC: NDArray) -> NDArray:
    """The basis of the third curve: one coefficient a width, whatever the temperature."""
    return np.ones((np.size(temperature_degC), len(HALF_WIDTHS_degC)))


def hysteresis_of(fit: CurveFit) -> Hysteresis:
    """What a fit with hysteresis says of it."""
    parts, P = fit.linear(H, np.eye(len(HALF_WIDTHS_degC)))
    value, sigma = float(parts[0]), float(np.sqrt(P[0, 0]))
    return Hysteresis(
        value_deg_h=value,
        sigma_deg_h=sigma,
        parts_deg_h=parts,
        held_apart=True,
        shown=abs(value) > SHOWN_SIGMAS * sigma,
    )


GRID_degC = 2.5
# a slow ramp faster than this share of the fast one is the same ramp again; the separation divides
# by their difference: 0.2 of a rate is 5 times the noise
EQUAL_RATES = 0.8
# of temperatures that both members of a pair must have passed: 5 points of GRID_degC, one more
# than a cubic has coefficients
OVERLAP_degC = 10.0
KT, KD = 0, 1


def document_subtraction(
    fast_deg_h: NDArray, slow_deg_h: NDArray, fast_rate: float, slow_rate: float
) -> tuple[NDArray, NDArray]:
    """K_T, K_delta as the document subtracts: the slow ramp is K_T, the difference over the fast
    rate K_delta.

    K_T keeps K_delta slow_rate and K_delta is read low by slow_rate / fast_rate (10 % in the
    document's example).
    """
    del slow_rate  # the document leaves it out: that is its error
    return np.asarray(slow_deg_h), (np.asarray(fast_deg_h) - slow_deg_h) / fast_rate


def exact_separation(
    fast_deg_h: NDArray, slow_deg_h: NDArray, fast_rate: float, slow_rate: float
) -> tuple[NDArray, NDArray]:
    """K_T, K_delta from two ramps at signed rates [degC/min]: two equations, two unknowns."""
    K_delta = (np.asarray(fast_deg_h) - slow_deg_h) / (fast_rate - slow_rate)
    return slow_deg_h - K_delta * slow_rate, K_delta


def up_down(up_deg_h: NDArray, down_deg_h: NDArray, rate: float) -> tuple[NDArray, NDArray]:
    """K_T, K_delta from one ramp up and one down at the same unsigned rate: the rate term is odd in
    dT/dt.
    """
    return 0.5 * (np.asarray(up_deg_h) + down_deg_h), (np.asarray(up_deg_h) - down_deg_h) / (
        2.0 * rate
    )


@dataclass(frozen=True)
class Curves:
    """K_T and K_delta on a temperature grid (k,) [degC], with covariances (k, k), or None where
    only values are stated.
    """

    temperature_degC: NDArray
    K_T_deg_h: NDArray
    K_delta: NDArray
    K_T_covariance: NDArray | None = None
    K_delta_covariance: NDArray | None = None


@dataclass(frozen=True)
class RampFit:
    """One gyro: the fit over all blocks and its curves; fast_pair: the same fit to the fast runs
    alone.

    document, two_ramps, fast_ramps: closed forms on smooth curves of single ramps (subtraction,
    exact separation, up and down), None where the runs lack the ramps.

    scatter: chi2 of the residual per degree of freedom by noise and drift alone. The sigmas hold
    it: what repeats at a temperature as a ripple of the curves (`fit_rough`), the rest as noise.
    level_deg_h, level_sigma_deg_h: mean of K_T over the grid, and how well it is known apart from
    Earth rate. hysteresis: taken out of `reduced` where the runs tell it; the curves' covariance
    has what is not known of it.
    """

    axis: str
    reduced: Reduced
    fit: CurveFit
    curves: Curves
    fast_pair: Curves | None
    document: Curves | None
    two_ramps: Curves | None
    fast_ramps: Curves | None
    scatter: float
    level_deg_h: float
    level_sigma_deg_h: float
    level_known: bool
    hysteresis: Hysteresis


@dataclass(frozen=True, kw_only=True)
class RampStudy(ThermalStudy):
    """All that came of the runs; axes: of the fitted gyros."""

    fast: tuple[RampRun, ...]
    slow: tuple[RampRun, ...]
    axes: tuple[RampFit, ...] = ()


def separate(
    fast: Sequence[RampRun],
    slow: Sequence[RampRun],
    twin: TwinModel,
    *,
    remounted: bool = False,
    one_sided: bool = False,
) -> RampStudy:
    """Fit every gyro with a thermometer. fast, slow: runs by their role; slow may be empty (the
    fast up/down pair alone).

    remounted: the unit was moved between runs, so each has its own unknown share of Earth rate
    (also found from the level). one_sided: accept ramps of one direction, where the level of
    K_delta rests on the repeatability of the turn-on bias.
    """
    runs = (*fast, *slow)
    notes = [because(ThermalNote.REMOUNTED)] if levels_differ(runs) else []
    if len({run.heading_known for run in runs}) > 1:
        notes.append(because(ThermalNote.SURVEYED_IN_PART))
    moved = remounted or bool(notes)
    study = RampStudy(
        fast=tuple(fast), slow=tuple(slow), twin=twin, notes=tuple(notes), remounted=moved
    )
    why = _cannot_separate(fast, slow, free=moved, one_sided=one_sided)
    if why:
        return replace(study, refused=why)
    usable, left_out = with_thermometer(runs)
    axes = tuple(_fit_axis(k, fast, slow, twin, moved) for k in usable)
    against = contradicted(axes, BiasDriver.RATE)
    return replace(
        study,
        axes=() if against else axes,
        notes=(*notes, *left_out, *_of_hysteresis(axes), *widened(axes)),
        inconsistent=against,
    )


def _of_hysteresis(axes: Sequence[RampFit]) -> list[Reason]:
    """What a reader must know of it."""
    untold = [a.hysteresis.sigma_deg_h for a in axes if not a.hysteresis.held_apart]
    told = [
        because(
            ThermalNote.HYSTERESIS,
            axis=a.axis,
            split_deg_h=2.0 * a.hysteresis.value_deg_h,
            sigma_deg_h=2.0 * a.hysteresis.sigma_deg_h,
        )
        for a in axes
        if a.hysteresis.shown
    ]
    if untold:
        told.append(because(ThermalNote.HYSTERESIS_UNTOLD, allowed_deg_h=max(untold)))
    return told


def _cannot_separate(
    fast: Sequence[RampRun], slow: Sequence[RampRun], *, free: bool, one_sided: bool
) -> tuple[Reason, ...]:
    """Reasons, each with what was measured, what was needed and what would help."""
    for role, runs in (("fast", fast), ("slow", slow)):
        for run in runs:
            why = moving_base(run, f"{role} run") or _no_ramp(run, role)
            if why:
                return why
    f_legs, s_legs = ([leg for run in runs for leg in run.legs] for runs in (fast, slow))
    f_rate = max(abs(leg.rate_degC_min) for leg in f_legs)
    s_rate = max((abs(leg.rate_degC_min) for leg in s_legs), default=0.0)
    if slow and s_rate > EQUAL_RATES * f_rate:
        equal = because(
            ThermalReason.EQUAL_RATES,
            fast_degC_min=f_rate,
            slow_degC_min=s_rate,
            needed_share=EQUAL_RATES,
        )
        return (equal,)
    two_rates = bool(slow) and not free
    directions = {leg.direction for leg in (f_legs if free else f_legs + s_legs)}
    if directions != {"up", "down"} and not (one_sided and two_rates):
        heats = f_legs[0].direction == "up"
        same = because(ThermalReason.SAME_SIGN, heats=heats, each_run=free, two_rates=two_rates)
        return (same,)
    overlap = _overlap(f_legs, s_legs, pair=not slow)
    if overlap < OVERLAP_degC:
        little = because(
            ThermalReason.LITTLE_OVERLAP,
            pair=not slow,
            overlap_degC=overlap,
            needed_degC=OVERLAP_degC,
        )
        return (little,)
    return ()


def _no_ramp(run: RampRun, role: str) -> tuple[Reason, ...]:
    """Why a run without a steady ramp cannot be used; empty where it has one."""
    if run.legs:
        return ()
    span = float(np.ptp(run.temperature_degC.mean(axis=1))) if run.time_s.size else 0.0
    return (because(ThermalReason.NO_RAMP, role=role, run_id=run.run_id, span_degC=span),)


def _overlap(fast: list[Leg], slow: list[Leg], *, pair: bool) -> float:
    """Widest range that a ramp of either kind passed [degC]: up and down, else fast and slow."""
    first = [leg for leg in fast if leg.direction == "up"] if pair else fast
    second = [leg for leg in fast if leg.direction == "down"] if pair else slow
    shared = [
        min(a.high_degC, b.high_degC) - max(a.low_degC, b.low_degC) for a in first for b in second
    ]
    return max([0.0, *shared])


def _fit_axis(
    k: int, fast: Sequence[RampRun], slow: Sequence[RampRun], twin: TwinModel, free: bool
) -> RampFit:
    runs = (*fast, *slow)
    blocks = axis_blocks(runs, k, twin, free=free)
    apart = bool(slow) and {leg.direction for run in runs for leg in run.legs} == {"up", "down"}
    blocks, terms = (with_sense(blocks, runs, k), 3) if apart else (blocks, 2)
    reduced, fit = _fitted(blocks, terms)
    scatter, left = fit.chi2_bare / max(fit.dof, 1.0), fit.chi2 / max(fit.dof, 1.0)
    if left > INFLATE_ABOVE:
        wider = np.sqrt(left)
        blocks = replace(blocks, sigma_deg_h=blocks.sigma_deg_h * wider, drift=blocks.drift * left)
        reduced, fit = _fitted(blocks, terms)
    T = blocks.temperature_degC
    low, high = np.ceil(T.min() / GRID_degC) * GRID_degC, np.floor(T.max() / GRID_degC) * GRID_degC
    grid = np.arange(low, high + 0.5 * GRID_degC, GRID_degC)
    curves = _curves(fit, grid, _rate_share(runs, k))
    if apart:
        hysteresis = hysteresis_of(fit)
        reduced = Reduced(without(blocks, hysteresis), reduced.rough)
    else:
        hysteresis = no_more_than(twin.gyro.turn_on_deg_h)
        curves = _unsure(curves, hysteresis, max(run.rate for run in fast))
    assert curves.K_T_covariance is not None
    # else it is in the covariance, run by run
    common = 0.0 if free else max(float(run.level_sigma_deg_h[k]) for run in runs)
    level_sigma = float(np.hypot(np.sqrt(curves.K_T_covariance.mean()), common))
    pair = None
    if slow and {leg.direction for run in fast for leg in run.legs} == {"up", "down"}:
        of_fast = axis_blocks(fast, k, twin, free=free)
        of_fast = without(with_sense(of_fast, fast, k), hysteresis)
        pair = _curves(_fitted(of_fast)[1], grid, _rate_share(fast, k))
        pair = _unsure(pair, hysteresis, max(run.rate for run in fast))
    document, two_ramps, fast_ramps = _closed_forms(fast, slow, k, twin, grid)
    return RampFit(
        axis=AXES[k],
        reduced=reduced,
        fit=fit,
        curves=curves,
        fast_pair=pair,
        document=document,
        two_ramps=two_ramps,
        fast_ramps=fast_ramps,
        scatter=scatter,
        level_deg_h=float(curves.K_T_deg_h.mean()),
        level_sigma_deg_h=level_sigma,
        level_known=level_sigma < 0.25 * max(float(np.ptp(curves.K_T_deg_h)), 1e-9)
        or all(run.heading_known for run in runs),
        hysteresis=hysteresis,
    )


def _unsure(curves: Curves, hysteresis: Hysteresis, rate_degC_min: float) -> Curves:
    """The curves of ramps at one rate with what a hysteresis may have put into K_delta."""
    assert curves.K_delta_covariance is not None
    P = curves.K_delta_covariance + (hysteresis.sigma_deg_h / rate_degC_min) ** 2
    return replace(curves, K_delta_covariance=P)


def _smooth(blocks: AxisBlocks) -> tuple[Basis, NDArray]:
    """The smooth basis over the range of the blocks, and its penalty."""
    T = blocks.temperature_degC
    return smooth_basis(float(T.min()), float(T.max()))


def _fitted(blocks: AxisBlocks, terms: int = 2) -> tuple[Reduced, CurveFit]:
    """Curves over the range of the blocks; terms 3: with hysteresis."""
    basis, penalty = _smooth(blocks)
    bases: list[Basis] = [basis, basis, each_width]
    penalties = [penalty, penalty, FREE_SIZE]
    return fit_rough(blocks, bases[:terms], penalties[:terms])


def _rate_share(runs: Sequence[RampRun], k: int) -> float:
    """Relative sigma of the rates: common to all that a ramp says of K_delta."""
    return min(float(run.rate_sigma_degC_min[k]) / run.rate for run in runs)


def _curves(fit: CurveFit, grid: NDArray, rate_share: float) -> Curves:
    K_T, P_T = fit.at(KT, grid)
    K_d, P_d = fit.at(KD, grid)
    return Curves(grid, K_T, K_d, P_T, P_d + rate_share**2 * np.outer(K_d, K_d))


def _closed_forms(
    fast: Sequence[RampRun], slow: Sequence[RampRun], k: int, twin: TwinModel, grid: NDArray
) -> tuple[Curves | None, Curves | None, Curves | None]:
    """Subtraction and exact separation, up with up, down with down, the two then averaged."""
    ramps = {
        (role, way): _ramp_curve(runs, way, k, twin, grid)
        for role, runs in (("fast", fast), ("slow", slow))
        for way in ("up", "down")
    }
    subtracted, exact = [], []
    for way in ("up", "down"):
        quick, steady = ramps["fast", way], ramps["slow", way]
        if quick is not None and steady is not None:
            subtracted.append(document_subtraction(quick[0], steady[0], quick[1], steady[1]))
            exact.append(exact_separation(quick[0], steady[0], quick[1], steady[1]))
    pairs = [
        Curves(grid, *np.mean(found, axis=0)) if found else None for found in (subtracted, exact)
    ]
    up, down = ramps["fast", "up"], ramps["fast", "down"]
    both = None if up is None or down is None else up_down(up[0], down[0], 0.5 * (up[1] - down[1]))
    return pairs[0], pairs[1], None if both is None else Curves(grid, *both)


def _ramp_curve(
    runs: Sequence[RampRun], direction: str, k: int, twin: TwinModel, grid: NDArray
) -> tuple[NDArray, float] | None:
    """Smooth curve of the bias over the first ramp of a direction, NaN where it did not pass, and
    its signed rate.
    """
    for run in runs:
        for leg in run.legs:
            if leg.direction == direction:
                blocks = axis_blocks([run], k, twin, rows=[np.arange(leg.start, leg.end)])
                basis, penalty = _smooth(blocks)
                value = Reduced(blocks).fit([basis], [penalty]).at(KT, grid)[0]
                T = blocks.temperature_degC
                return (
                    np.where((grid >= T.min()) & (grid <= T.max()), value, np.nan),
                    leg.rate_degC_min,
                )
    return None
