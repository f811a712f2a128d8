"""What a session takes for granted where no table or twin declares it."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ins.noise import (
    DEFLECTION_M,
    ACCEL_SCALE_ppm,
    ACCEL_SLOPE_ug_degC,
    DEFLECTION_arcsec,
    GYRO_SCALE_ppm,
    MISALIGNMENT_mrad,
)
from ins.records import TwinModel
from ins.units import ARCSEC

BIN_S = 300.0
FIT: Literal["fit"] = "fit"  # of a level that the data are to find


def _by_technology(rlg: float, fog: float, mems: float) -> dict[str, float]:
    return {"rlg": rlg, "fog": fog, "mems": mems}


@dataclass(frozen=True, kw_only=True)
class FlightPriors:
    """Prior sigmas of a flight's nuisances; each is an assumption and is named in the report.

    Receivers: a single-frequency solution strays by 1 to 2 m over minutes (ionosphere, orbits);
    positions and velocities lag by 0.1 to 0.2 s (`infield.session.navigated.nuisances`). Verticals
    are deflected by some 5 arcsec RMS over 20 to 50 km (physics.md 8.4), in mountains by 30: "fit"
    has the flight find both. Accelerometers of a
    navigation-grade unit repeat their scale within 100 ppm (`infield.session.wrong_facts`); what
    its compensation leaves of their temperature slope is taken as 0.2 micro-g per degC. What
    vibration and pressure change in flight is taken as a tenth of the default turn-on of a gyro,
    and as 5 micro-g of an accelerometer (quartz: some 30 micro-g per g^2 of vibration, 0.4 g in a
    cabin).
    """

    slow_position_m: float = 1.5
    slow_position_s: float = 300.0
    slow_velocity_m_s: float = 0.01
    slow_velocity_s: float = 60.0
    antenna_m: float = 0.3
    delay_s: float = 0.3
    accel_scale_ppm: dict[str, float] = field(default_factory=lambda: dict(ACCEL_SCALE_ppm))
    accel_shift_ug: dict[str, float] = field(
        default_factory=lambda: _by_technology(5.0, 5.0, 500.0)
    )
    accel_slope_ug_degC: dict[str, float] = field(default_factory=lambda: dict(ACCEL_SLOPE_ug_degC))
    misalignment_mrad: dict[str, float] = field(default_factory=lambda: dict(MISALIGNMENT_mrad))
    shift_deg_h: dict[str, float] = field(
        default_factory=lambda: _by_technology(0.0003, 0.0003, 3.0)
    )
    force_deg_h_g: dict[str, float] = field(
        default_factory=lambda: _by_technology(0.0, 0.001, 10.0)
    )
    deflection_arcsec: float | Literal["fit"] = FIT
    deflection_km: float | Literal["fit"] = FIT

    @property
    def assumed(self) -> "FlightPriors":
        """The same with numbers for what the flight is to find: what is usual."""
        return replace(
            self,
            deflection_arcsec=self.deflection_rad / ARCSEC,
            deflection_km=self.deflection_m / 1e3,
        )

    @property
    def deflection_rad(self) -> float:
        """As given, else what is usual; likewise the length."""
        size = self.deflection_arcsec
        return ARCSEC * (DEFLECTION_arcsec if size == FIT else size)

    @property
    def deflection_m(self) -> float:
        length = self.deflection_km
        return DEFLECTION_M if length == FIT else 1e3 * length


@dataclass(frozen=True, kw_only=True)
class SessionSettings:
    """Prior sigmas of what no table or twin declares; each is an assumption and is named as one in
    the report.
    """

    bin_s: float = BIN_S
    sigma_crab_mrad: float = 10.0
    sigma_lever_arm_m: float = 5.0
    sigma_odometer_scale: float = 0.05  # worn or wrongly entered wheels
    sigma_scale_factor_ppm: dict[str, float] = field(default_factory=lambda: dict(GYRO_SCALE_ppm))
    sigma_misalignment_mrad: float = 0.01
    hold_heading: bool = True
    use_gnss: bool = True
    use_odometer: bool = True
    check_unit: bool = True  # hold accelerometers and thermometers against the unit's history
    flight: FlightPriors = field(default_factory=FlightPriors)

    def with_shift(self, technology: str, size_deg_h: float) -> "SessionSettings":
        """The same with a prior of what gyros read in flight beyond what they read at rest that is
        at least so large (1 sigma).
        """
        prior = self.flight.shift_deg_h
        wider = {**prior, technology: max(prior[technology], size_deg_h)}
        return replace(self, flight=replace(self.flight, shift_deg_h=wider))


def misalignment_sigma_mrad(twin: TwinModel, settings: SessionSettings) -> NDArray:
    """What Earth rate couples into x, y, z beyond the twin's misalignment, 1 sigma (3,): as
    measured, else as assumed.
    """
    measured = np.linalg.norm(np.reshape(twin.gyro.sigma_misalignment_mrad, (3, 2)), axis=1)
    return np.where(measured > 0, measured, settings.sigma_misalignment_mrad)
