"""What a session takes for granted where no table or twin declares it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ins.records import TwinModel

BIN_S = 300.0


@dataclass(frozen=True, kw_only=True)
class SessionSettings:
    """Prior sigmas of what no table or twin declares; each is an assumption and is named as one in
    the report.
    """

    bin_s: float = BIN_S
    sigma_crab_mrad: float = 10.0
    sigma_lever_arm_m: float = 5.0
    sigma_odometer_scale: float = 0.05  # worn or wrongly entered wheels
    sigma_scale_factor_ppm: dict[str, float] = field(
        default_factory=lambda: {"rlg": 5.0, "fog": 50.0, "mems": 5000.0}
    )
    sigma_misalignment_mrad: float = 0.01
    hold_heading: bool = True
    use_gnss: bool = True
    use_odometer: bool = True


def misalignment_sigma_mrad(twin: TwinModel, settings: SessionSettings) -> NDArray:
    """What Earth rate couples into x, y, z beyond the twin's misalignment, 1 sigma (3,): as
    measured, else as assumed.
    """
    measured = np.linalg.norm(np.reshape(twin.gyro.sigma_misalignment_mrad, (3, 2)), axis=1)
    return np.where(measured > 0, measured, settings.sigma_misalignment_mrad)
