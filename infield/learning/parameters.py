"""What is learnt of a technology of gyros, and what is believed of it before any session.

Every parameter is positive and is learnt by its logarithm: a normal distribution of the logarithm,
centred on the default of the technology (`default_twin`, physics.md 6.8), with a stated width.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from infield.table.thermal_table import AgeingModel, KERNEL_LENGTH_degC
from ins.errors.catalogue import prior
from ins.errors.table import OUTLIER, TABLE_AGED, DEFAULT_SIGMA_deg_h
from ins.twin_file import default_twin


class PriorName(StrEnum):
    """A parameter of a technology, a type or a unit (formats.md, section 6: `recal.priors/1`)."""

    TURN_ON = "turn_on"
    FLICKER = "flicker"
    RANDOM_WALK = "random_walk"
    AGEING_COMMON = "ageing_common_per_sqrt_year"
    AGEING_SHAPE = "ageing_shape_per_sqrt_year"
    LENGTH = "length_degC"
    YAW_CREEP = "yaw_creep"
    OUTLIER_SHARE = "outlier_share"
    CRAB = "crab"


# those that the points of the sessions show, in the order of every vector; crab has a channel of
# its own, the crab that each taxi estimated
OF_POINTS = tuple(name for name in PriorName if name is not PriorName.CRAB)
UNITS: Mapping[PriorName, str] = {
    PriorName.TURN_ON: "deg/h",
    PriorName.FLICKER: "deg/h",
    PriorName.RANDOM_WALK: "deg/h/sqrt(h)",
    PriorName.AGEING_COMMON: "deg/h/sqrt(year)",
    PriorName.AGEING_SHAPE: "deg/h/sqrt(year)",
    PriorName.LENGTH: "degC",
    PriorName.YAW_CREEP: "arcsec/sqrt(h)",
    PriorName.OUTLIER_SHARE: "1",
    PriorName.CRAB: "mrad",
}
# Width of the hyperprior, one sigma of the natural logarithm: ln 3, a default that is a factor 3
# off lies at one sigma; the length of correlation and the crab are known better.
FACTOR_THREE = float(np.log(3.0))
WIDTHS: Mapping[PriorName, float] = {
    **dict.fromkeys(PriorName, FACTOR_THREE),
    PriorName.LENGTH: 0.5,
    PriorName.CRAB: 0.7,
}
# one sigma of the logarithm of a type about its technology, and of a unit about its type: what data
# sheets give as spread of one model (25 %)
TYPE_SPREAD = 0.3
UNIT_SPREAD = 0.25
# size of an outlier's common shift relative to the sigma of a unit without a table
OUTLIER_SIZE = OUTLIER.prior("learning", "size").size


def defaults_of(technology: str) -> dict[PriorName, float]:
    """The centre of the hyperprior: what is believed of a technology that nobody has measured."""
    twin, sigma = default_twin(technology), DEFAULT_SIGMA_deg_h[technology]
    return {
        PriorName.TURN_ON: twin.gyro.turn_on_deg_h,
        PriorName.FLICKER: twin.gyro.bias_instability_deg_h,
        PriorName.RANDOM_WALK: twin.gyro.rate_random_walk_deg_h_sqrt_h,
        PriorName.AGEING_COMMON: prior(TABLE_AGED, "learning", "common").size * sigma,
        PriorName.AGEING_SHAPE: prior(TABLE_AGED, "learning", "shape").size * sigma,
        PriorName.LENGTH: KERNEL_LENGTH_degC,
        PriorName.YAW_CREEP: twin.vehicle.yaw_creep_arcsec_sqrt_h,
        PriorName.OUTLIER_SHARE: OUTLIER.prior("learning", "share").size,
        PriorName.CRAB: prior("odometer_boresight", "learning").size,
    }


def ageing_of(values: Mapping[PriorName, float] | Mapping[str, float]) -> AgeingModel:
    """How tables age."""
    return AgeingModel(
        common_deg_h_sqrt_year=values[PriorName.AGEING_COMMON],
        shape_deg_h_sqrt_year=values[PriorName.AGEING_SHAPE],
        length_degC=values[PriorName.LENGTH],
    )


def logs_of(values: Mapping[PriorName, float]) -> NDArray:
    """The logarithms (p,) of what the points show, in the order of `OF_POINTS`."""
    return np.log([values[name] for name in OF_POINTS])


@dataclass(frozen=True)
class HyperPrior:
    """Independent normal distributions of the logarithms: mean (p,) and sigma (p,)."""

    mean: NDArray
    sigma: NDArray

    def log_density(self, theta: NDArray) -> float:
        """Up to a constant."""
        return float(-0.5 * np.sum(((theta - self.mean) / self.sigma) ** 2))


def hyperprior_of(technology: str) -> HyperPrior:
    """What is believed of a technology before any session."""
    widths = np.array([WIDTHS[name] for name in OF_POINTS])
    return HyperPrior(logs_of(defaults_of(technology)), widths)
