"""The update of the rows so far and what more would bring, in a process of its own (`worker`).

Its rows are those of `part_rows`, summed to 10 Hz: the estimate has the sigmas of the whole log to
their third digit and takes a second of CPU for an hour. What is stored in the end is estimated from
all rows (`session`).
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from infield.session.estimate import SessionEstimate
from infield.session.points import mean_rows
from ins.attitude import euler_from_dcm
from ins.estimation.states import THETA
from ins.records import AXES, InputError, Run
from ins.units import DEG, MINUTE
from ins.verdicts import Outcome, Reason, sentence
from recal.service.inputs.records import AnyTwin
from recal.service.update import Update, update
from recal.service.watch.part_rows import PartRows
from recal.service.watch.reasons import waits
from recal.service.watch.records import ALIGNING, FIRST_S, Estimated, GyroState
from simreal.plan.ahead import TAXI, TURN, Outlook, outlook, stay
from trajectories.runs.checks import Findings

STAYS_MIN = (5.0, 10.0, 20.0, 40.0)
GRID_MIN = np.arange(1.0, STAYS_MIN[-1] + 1.0)
# of a sigma that ten more minutes bring: less is nothing; chosen: half of what makes a gyro
# "weak" (10 %)
NOTHING_SHARE = 0.05
NOTHING_MIN = 10
# of the sigma after as long a stay: below, a motion shows what rest does not; chosen: 10 %
MOVES_SHARE = 0.9


@dataclass(frozen=True, kw_only=True)
class InterimRequest:
    """What an estimate of the rows so far takes from the command."""

    store_url: str
    twin: AnyTwin | None = None
    config: Path | None = None
    thermal_model: Path | None = None
    target_deg_h: float | None = None


_PARTS: dict[Path, "PartRows"] = {}  # of the process, what it has read


def read(parts: Sequence[Path]) -> None:
    """Read what was recorded since."""
    for path in parts:
        if path not in _PARTS:
            _PARTS[path] = PartRows(path)
        _PARTS[path].read()


def estimated(parts: Sequence[Path], request: InterimRequest) -> Estimated | None:
    """The update of the rows that were read; None where they are too few."""
    begun = time.process_time()
    findings = Findings()
    runs = [_PARTS[path].run(findings) for path in parts]
    known = [run for run in runs if run is not None and run.imu.end_s >= FIRST_S]
    if not known:
        return None
    try:
        result = update(
            known,
            twin=request.twin,
            store=request.store_url,
            config=request.config,
            thermal_model=request.thermal_model,
        )
    except InputError as error:
        return _refused(known[-1], [*_said(findings), str(error)], time.process_time() - begun)
    found = _found(result, known[-1], findings, request.target_deg_h)
    return replace(found, cpu_s=time.process_time() - begun)


def _said(findings: Findings) -> list[str]:
    return [item.text for item in findings.items if item.level != "warning" or "stuck" in item.text]


def _waiting(found: Estimated, wait: Reason | None) -> Estimated:
    """The estimate, as of a session that is aligning where it waits for something."""
    if wait is None or found.verdict != Outcome.REFUSED:
        return found
    return replace(
        found,
        verdict=ALIGNING,
        waits_for=sentence(wait),
        waits_s=wait.values.get("left_s"),
        document=None,  # its report would say refused
    )


def _refused(run: Run, faults: Sequence[str], cpu_s: float) -> Estimated:
    return Estimated(
        until_s=float(run.imu.end_s),
        verdict=Outcome.REFUSED.value,
        used_s=0.0,
        excluded_s={},
        heading_deg=None,
        sigma_heading_deg=None,
        gyros={},
        faults=tuple(faults),
        cpu_s=cpu_s,
    )


def _found(result: Update, run: Run, findings: Findings, target_deg_h: float | None) -> Estimated:
    """What an update says of the last part."""
    document, session = result.record, result.estimate.sessions[-1]
    wait = waits(session.verdict.reasons, run.imu.end_s)
    faults = [*_said(findings), *(document.reasons if wait is None else ())]
    estimate = session.estimate
    if estimate is None or session.temperature is None:
        return _waiting(_refused(run, faults, 0.0), wait)
    excluded: dict[str, float] = {}
    for span in document.excluded:
        why = str(span.reason)
        excluded[why] = excluded.get(why, 0.0) + span.end_s - span.start_s
    heading, sigma = _heading(estimate)
    targets = [_target(result, session.temperature, k, target_deg_h) for k in range(3)]
    now = tuple(axis.sigma_after_deg_h for axis in session.seen)
    ahead: list[Outlook] = []
    if any(one > target for one, target in zip(now, targets)):
        ahead = outlook(result.estimate, [*map(stay, STAYS_MIN), TURN, TAXI])
    advice = advised(now, targets, ahead)
    bias = mean_rows(estimate) @ (estimate.bins.table_deg_h + estimate.mean_deg_h)
    gyros = {
        axis: GyroState(
            bias_deg_h=float(bias[k]),
            sigma_before_deg_h=session.seen[k].sigma_before_deg_h,
            sigma_now_deg_h=now[k],
            sigma_plan_deg_h=None if advice.plan_deg_h is None else advice.plan_deg_h[k],
            target_deg_h=targets[k],
        )
        for k, axis in enumerate(AXES)
    }
    doubted = getattr(document.sessions[-1], "doubted", None) or ()
    found = Estimated(
        until_s=float(run.imu.end_s),
        verdict=str(document.verdict),
        used_s=float(run.imu.end_s - run.imu.start_s - sum(excluded.values())),
        excluded_s=dict(excluded),
        heading_deg=heading,
        sigma_heading_deg=sigma,
        gyros=gyros,
        at_end_degC=_at_end(ahead),
        faults=(*faults, *doubted),
        advice=advice.lines,
        enough=advice.enough,
        plan_min=advice.plan_min,
        document=document,
    )
    return _waiting(found, wait)


def _heading(estimate: SessionEstimate) -> tuple[float | None, float | None]:
    """Heading and its sigma at the end [deg]; None of a unit that finds none."""
    solution = estimate.solution
    if solution is None:
        return None, None
    down = THETA.stop - 1
    heading = euler_from_dcm(solution.history.C_nb[-1])[2] - solution.filter.x[down]
    sigma = np.sqrt(solution.filter.P[down, down])
    return float(heading / DEG) % 360.0, float(sigma / DEG)


def _target(result: Update, temperature, axis: int, given: float | None) -> float:
    """What sigma a gyro is to reach: half of what the table claims where it stands now."""
    if given is not None:
        return given
    now_degC = temperature.temperature_degC[-1, axis]
    return 0.5 * float(result.table_before.sigma_deg_h(axis, now_degC)[0])


def _at_end(ahead: Sequence[Outlook]) -> tuple[float, ...]:
    """Gyro temperatures at the end of the longest stay [degC]."""
    stays = [found for found in ahead if found.name == "stay"]
    return stays[-1].gyro_degC if stays else ()


@dataclass(frozen=True, kw_only=True)
class Advice:
    """Lines to read, the stay that they plan [min] and the sigmas after it [deg/h]."""

    lines: tuple[str, ...]
    enough: bool
    plan_min: float | None = None
    plan_deg_h: tuple[float, ...] | None = None


def advised(
    now_deg_h: Sequence[float], target_deg_h: Sequence[float], ahead: Sequence[Outlook]
) -> Advice:
    """What each candidate brings, and whether anything is left to bring.

    Parameters
    ----------
    now_deg_h, target_deg_h : sequence of three floats
        Sigma of each gyro now, and what it is to reach.
    ahead : sequence of Outlook
        Of stays of STAYS_MIN and of motions.

    Returns
    -------
    Advice
    """
    now, target = np.array(now_deg_h), np.array(target_deg_h)
    open_axes = now > target
    if not open_axes.any():
        return Advice(lines=("enough: every gyro is below its target",), enough=True)
    stays = [found for found in ahead if found.name == "stay"]
    if not stays:
        return Advice(lines=("at rest, what more would bring is predicted",), enough=False)
    along = _along(now, stays)
    minutes, row, lines = _stay(now, target, along)
    for found in ahead:
        told = [] if found.name == "stay" else _motion(found, now, along)
        lines += told
        if told and minutes is None:
            minutes, row = found.duration_s / MINUTE, np.array(found.sigma_deg_h)
    return Advice(
        lines=tuple(lines), enough=False, plan_min=minutes, plan_deg_h=tuple(row.tolist())
    )


def _along(now: NDArray, stays: Sequence[Outlook]) -> NDArray:
    """Sigma (m, 3) after each minute of GRID_MIN: information is straight between the stays."""
    at_min = [0.0, *(found.duration_s / MINUTE for found in stays)]
    sigma = np.array([now, *(found.sigma_deg_h for found in stays)])
    columns = [np.interp(GRID_MIN, at_min, sigma[:, k] ** -2.0) for k in range(3)]
    return np.asarray(np.stack(columns, axis=1) ** -0.5)


def _stay(now: NDArray, target: NDArray, along: NDArray) -> tuple[float | None, NDArray, list[str]]:
    """The stay to plan, None where none brings a gyro nearer to its target, sigmas after it, and
    what it brings.
    """
    is_open = now > target
    reach = is_open & (along[-1] <= target)
    if reach.any():
        k = int(np.argmax((along[:, reach] <= target[reach]).all(axis=1)))
        more = f": {_named(reach)} below the target"
    else:
        later = np.minimum(np.arange(len(along)) + NOTHING_MIN, len(along) - 1)
        less = along[later] < (1.0 - NOTHING_SHARE) * along
        gains = np.asarray(less[:, is_open].any(axis=1))
        gains[len(along) - NOTHING_MIN :] = gains[len(along) - NOTHING_MIN - 1]
        k = len(along) - 1 if gains.all() else int(np.argmin(gains))
        more = "" if gains.all() else "; after that, 10 min bring less than 5 %"
    gained = is_open & (along[k] < (1.0 - NOTHING_SHARE) * now)
    if not gained.any():
        return None, now, [f"more rest on this heading adds nothing to {_named(is_open)}"]
    line = f"{GRID_MIN[k]:.0f} min more at rest: {_arrows(now, along[k], gained)}{more}"
    return float(GRID_MIN[k]), along[k], [line]


def _named(axes: NDArray) -> str:
    return " and ".join(axis for axis, on in zip(AXES, axes) if on)


def _motion(found: Outlook, now: NDArray, along: NDArray) -> list[str]:
    """What a motion shows that as long a rest does not."""
    sigma = np.array(found.sigma_deg_h)
    minutes = found.duration_s / MINUTE
    rest = along[min(max(round(minutes), 1), len(along)) - 1]
    gained = sigma < MOVES_SHARE * rest
    if not gained.any():
        return []
    words = {
        "turn": "a turn by 90 deg and 5 min at rest",
        "taxi": f"a taxi with two turns and stops ({minutes:.0f} min)",
    }
    return [f"{words[found.name]} would show {_arrows(now, sigma, gained)}"]


def _arrows(now: NDArray, after: NDArray, shown: NDArray) -> str:
    parts = [f"{axis} {a:.4f} -> {b:.4f}" for axis, a, b, on in zip(AXES, now, after, shown) if on]
    return f"{', '.join(parts)} deg/h"
