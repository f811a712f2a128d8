"""What to do now, from the sigmas that candidate continuations would bring."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ins.records import AXES
from ins.units import MINUTE
from simreal.plan.ahead import Outlook

STAYS_MIN = (5.0, 10.0, 20.0, 40.0)
GRID_MIN = np.arange(1.0, STAYS_MIN[-1] + 1.0)
# of a sigma that ten more minutes bring: less is nothing; chosen: half of what makes a gyro
# "weak" (10 %)
NOTHING_SHARE = 0.05
NOTHING_MIN = 10
# of the sigma after as long a stay: below, a motion shows what rest does not; chosen: 10 %
MOVES_SHARE = 0.9


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
