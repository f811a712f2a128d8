"""What a session takes for granted where no table or twin declares it."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ins.errors.catalogue import prior
from ins.records import TwinModel
from ins.units import ARCSEC

BIN_S = 300.0
FIT: Literal["fit"] = "fit"  # of a level that the data are to find


_SLOW, _SLOW_VELOCITY = (
    prior("gnss_slow_error", "flight", part) for part in ("position", "velocity")
)
_ANTENNA, _DELAY = (
    prior("gnss_lever_arm_or_latency", "flight", part) for part in ("arm", "latency")
)
_DEFLECTION = prior("vertical_deflection", "flight")


@dataclass(frozen=True, kw_only=True)
class FlightPriors:
    """Prior sigmas of a flight's nuisances, as in the list of errors (`ins.errors`, effects.md 2d);
    each is an assumption and is named in the report. "fit" has the flight find how far and over
    which way the vertical is deflected.
    """

    slow_position_m: float = _SLOW.size
    slow_position_s: float = _SLOW.scale
    slow_velocity_m_s: float = _SLOW_VELOCITY.size
    slow_velocity_s: float = _SLOW_VELOCITY.scale
    antenna_m: float = _ANTENNA.size
    delay_s: float = _DELAY.size
    accel_scale_ppm: dict[str, float] = field(
        default_factory=prior("accel_scale_factor", "flight").each
    )
    accel_shift_ug: dict[str, float] = field(
        default_factory=prior("accel_in_flight", "flight").each
    )
    accel_slope_ug_degC: dict[str, float] = field(
        default_factory=prior("accel_thermal", "flight", "linear").each
    )
    misalignment_mrad: dict[str, float] = field(
        default_factory=prior("gyro_misalignment_x", "flight").each
    )
    shift_deg_h: dict[str, float] = field(default_factory=prior("gyro_in_flight", "flight").each)
    force_deg_h_g: dict[str, float] = field(
        default_factory=prior("gyro_g_sensitivity", "flight").each
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
        return ARCSEC * (_DEFLECTION.size if size == FIT else size)

    @property
    def deflection_m(self) -> float:
        length = self.deflection_km
        return _DEFLECTION.scale if length == FIT else 1e3 * length


@dataclass(frozen=True, kw_only=True)
class SessionSettings:
    """Prior sigmas of what no table or twin declares; each is an assumption and is named as one in
    the report.
    """

    bin_s: float = BIN_S
    sigma_crab_mrad: float = prior("odometer_boresight", "session").size
    sigma_lever_arm_m: float = prior("lever_arm", "session", "x").size
    sigma_odometer_scale: float = prior("odometer_scale", "session").size
    sigma_scale_factor_ppm: dict[str, float] = field(
        default_factory=prior("gyro_scale_factor", "session").each
    )
    sigma_misalignment_mrad: dict[str, float] = field(
        default_factory=prior("gyro_misalignment_x", "session").each
    )
    hold_heading: bool = True
    use_gnss: bool = True
    use_odometer: bool = True
    claim_chain: bool = True  # the patent's own path as well, for the report
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
    assumed = settings.sigma_misalignment_mrad[twin.gyro_technology]
    return np.where(measured > 0, measured, assumed)
