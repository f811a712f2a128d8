"""Which noise makes the variance of a session's biases, by running its filter under a little more
and a little less of each.

Decision: docs/decisions/0075-variance-shares.md.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.navigation_filter import PARKED, Aid, FilterPass, LaidDown
from infield.session.reasons import VarianceSource
from ins.estimation.tape import MEASURE, Compiled
from ins.units import DEG_PER_HOUR

# change of ln q to either side; central differences are off by its square over 6, 1e-3 of a part
STEP_LN = 0.1


@dataclass(frozen=True)
class _Setting:
    """What a sweep of the filter depends on."""

    last: FilterPass
    laid: LaidDown
    sigma0: Mapping[str, float]

    def covariance(self) -> NDArray:
        """Of the bins (3N, 3N) [(deg/h)^2], after the sweep."""
        return self.last.over(self.laid, self.sigma0).bias[1] / DEG_PER_HOUR**2


Scaled = Callable[[_Setting, float], _Setting]


def noise_shares(
    last: FilterPass, sigma0: Mapping[str, float], aids: Sequence[Aid], left: NDArray
) -> Mapping[VarianceSource, NDArray]:
    """Parts of a session's information about its bins (3N, 3N) [1/(deg/h)^2], by source of noise.

    Parameters
    ----------
    last : FilterPass
        The last pass of the solution.
    sigma0 : mapping of float
        Prior sigmas of nuisance states.
    aids : sequence of Aid
    left : ndarray, shape (3N, 3N)
        Covariance of the Earth rate that an error of the latitude leaves in the bins [(rad/s)^2]:
        the filter's biases hold it.

    Returns
    -------
    shares : mapping of ndarray
        Of the named sources; what is left to the whole is of sources without a name (the start,
        repaired faults).
    """
    setting = _Setting(last, last.lay_down(aids), sigma0)
    inverse = np.linalg.inv(setting.covariance())
    D = left / DEG_PER_HOUR**2
    of_sums = inverse - np.linalg.inv(last.bias_covariance / DEG_PER_HOUR**2)
    # (R + D)^-1 = W R^-1, and so are its parts
    W = np.linalg.inv(np.eye(len(D)) + of_sums @ D)
    information = W @ of_sums
    found = {VarianceSource.LATITUDE: information @ D @ information.T}
    for source, scaled in SCALED.items():
        more = scaled(setting, float(np.exp(0.5 * STEP_LN))).covariance()
        less = scaled(setting, float(np.exp(-0.5 * STEP_LN))).covariance()
        part = W @ inverse @ ((more - less) / (2.0 * STEP_LN)) @ inverse @ W.T
        found[source] = 0.5 * (part + part.T)
    return found


def _louder(record: Any, scale: float, *names: str) -> Any:
    """A record with some of its values `scale` times as large."""
    return replace(record, **{name: scale * getattr(record, name) for name in names})


def _of_twin(setting: _Setting, part: str, scale: float, *names: str) -> _Setting:
    """The setting with some noise of a part of its twin `scale` times as large."""
    twin = setting.last.twin
    louder = replace(twin, **{part: _louder(getattr(twin, part), scale, *names)})
    return replace(setting, last=replace(setting.last, twin=louder))


def _white(setting: _Setting, scale: float) -> _Setting:
    return _of_twin(setting, "gyro", scale, "arw_deg_sqrt_h")


def _accelerometers(setting: _Setting, scale: float) -> _Setting:
    white, walk = "vrw_ug_sqrt_hz", "rate_random_walk_ug_sqrt_h"
    return _of_twin(setting, "accel", scale, white, walk, "bias_instability_ug", "turn_on_ug")


def _standing(setting: _Setting, scale: float) -> _Setting:
    moved = _of_twin(setting, "vehicle", scale, "yaw_creep_arcsec_sqrt_h")
    walks = "place_walk_m", "yaw_walk_rad"
    parked = _louder(
        moved.last.parked, scale, "displacement_sigma_m", "yaw_jitter_rad", "swing_m", *walks
    )
    return replace(moved, last=replace(moved.last, parked=parked))


def _rolling(setting: _Setting, scale: float) -> _Setting:
    tape = setting.laid.tape
    variance = tape.variance.copy()
    variance[_rows_of_aids(tape)] *= scale**2
    noisier = replace(setting.laid, tape=replace(tape, variance=variance))
    sigma0 = {name: scale * sigma for name, sigma in setting.sigma0.items()}
    moved = _of_twin(setting, "vehicle", scale, "lateral_noise_m_s")
    return replace(moved, laid=noisier, sigma0=sigma0)


def _rows_of_aids(tape: Compiled) -> NDArray:
    """Rows of a tape that measure something else than a standing vehicle."""
    of_parked = np.isin(tape.name, [k for k, n in enumerate(tape.names) if n in PARKED])
    rows = [np.zeros(0, dtype=np.int64)]
    for _, _, first, count in tape.ops[(tape.ops[:, 0] == MEASURE) & ~of_parked]:
        rows.append(np.arange(first, first + count))
    return np.concatenate(rows)


SCALED: Mapping[VarianceSource, Scaled] = {
    VarianceSource.ANGLE_RANDOM_WALK: _white,
    VarianceSource.ACCELEROMETERS: _accelerometers,
    VarianceSource.STANDING: _standing,
    VarianceSource.ROLLING: _rolling,
}
