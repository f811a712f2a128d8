"""Between a thermal table and an autopilot's parameters: the cubic that goes out with its error,
the table that comes in.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from infield.table.autopilot_params import (
    ARDUPILOT,
    ARDUPILOT_REFERENCE_DEGC,
    PX4,
    AutopilotCubic,
    file_text,
)
from infield.table.cubic_fit import FORCED, CubicFit, fit_cubics, valid_range
from infield.table.thermal_table import COMMON_FRACTION, ThermalTable, prior_covariance
from ins.earth import EARTH_RATE_RAD_S
from ins.records import AXES
from ins.twin_file import default_twin
from ins.units import DEG_PER_HOUR

FIT_LIMIT_SIGMAS = 1.0  # of the table: a cubic that is further off anywhere is refused
FREE_LEVEL_DEG_H = 3600.0  # zero-rate offset of an autopilot's gyro, +-1 deg/s
# of the nodes that an imported cubic is laid on; Hermite, so exact between them too
SPACING_DEGC = 10.0
MISFIT_LENGTH = 0.1  # of the range: what a cubic leaves changes sign five times or more over it
TITLES = {PX4: "PX4", ARDUPILOT: "ArduPilot"}


@dataclass(frozen=True, kw_only=True)
class CubicDocument:
    """What an export says of its cubic; imu: its number."""

    autopilot: str
    imu: int
    range_degC: tuple[float, float]
    reference_degC: float
    limit_sigmas: float
    rounding_deg_h: float
    fit: Mapping[str, CubicFit]


@dataclass(frozen=True, kw_only=True)
class CubicExport:
    """What an export would write and how well it fits; `too_stiff`: why it is refused, empty where
    it is not.
    """

    cubic: AutopilotCubic
    fits: tuple[CubicFit, CubicFit, CubicFit]
    rounding_deg_h: float
    limit_sigmas: float
    too_stiff: tuple[str, ...]

    def fit_document(self) -> CubicDocument:
        """For --json."""
        c = self.cubic
        return CubicDocument(
            autopilot=c.autopilot,
            imu=c.number,
            range_degC=(c.low_degC, c.high_degC),
            reference_degC=c.reference_degC,
            limit_sigmas=self.limit_sigmas,
            rounding_deg_h=self.rounding_deg_h,
            fit={fit.axis: fit for fit in self.fits},
        )

    def fit_lines(self) -> list[str]:
        """The fit in words, for the file and for people."""
        c = self.cubic
        return [
            (
                f"cubic over {c.low_degC:.1f} to {c.high_degC:.1f} degC about"
                f" {c.reference_degC:.2f} degC, end values held beyond"
            ),
            *(fit.words() for fit in self.fits),
            f"rounding to float32 adds at most {self.rounding_deg_h:.1g} deg/h",
        ]

    def text(self, *, unit: str, revision: int, sha256: str) -> str:
        """The file, its comments telling what it is, how well it fits, and what else must be
        set.
        """
        forced = [f"{FORCED}: {reason}" for reason in self.too_stiff]
        head = (
            f"Thermal gyro parameters for {TITLES[self.cubic.autopilot]}, from recal's table of"
            f" {unit}, revision {revision}"
        )
        return file_text(
            self.cubic,
            [
                head,
                f"table sha256 {sha256}",
                *forced,
                *self.fit_lines(),
                *self._advice(),
                (
                    "these values replace what the autopilot holds, they are never added to it; a"
                    " log of rates that it has already"
                ),
                (
                    "corrected with them needs applied_table_sha256 (as above) in its run.json,"
                    " else the bias is counted twice"
                ),
            ],
        )

    def _advice(self) -> list[str]:
        n = self.cubic.number
        if self.cubic.autopilot == PX4:
            return [
                (
                    "rad/s, subtracted from sensor_gyro in the sensor's axes; set TC_G_ENABLE to 1"
                    " and restart"
                ),
                (
                    "the constant is in X0: set CAL_GYROk_XOFF, YOFF, ZOFF of this sensor to 0"
                    " first, else it counts twice;"
                ),
                "then run PX4's own gyro calibration again",
            ]
        at = ", ".join(f"{fit.axis} {fit.coefficients[0]:+.2f}" for fit in self.fits)
        return [
            (
                "1e-6 rad/s, in the sensor's axes (with AHRS_ORIENTATION 0 the table's);"
                f" INS_TCAL{n}_ACC* stay as they are"
            ),
            f"no constant: ArduPilot measures it at a start. At 35 degC the table says {at} deg/h",
        ]


def export_cubic(
    table: ThermalTable,
    autopilot: str,
    *,
    number: int,
    device_id: int = 0,
    span_degC: tuple[float, float] | None = None,
    limit_sigmas: float = FIT_LIMIT_SIGMAS,
) -> CubicExport:
    """The table as the autopilot's cubic. InputError where the range is beyond the table."""
    low, high = span_degC or (round(edge, 1) for edge in valid_range(table))
    if span_degC is None:
        low, high = (float(np.clip(edge, *_shared_nodes(table))) for edge in (low, high))
    reference = ARDUPILOT_REFERENCE_DEGC if autopilot == ARDUPILOT else 0.5 * (low + high)
    fits = fit_cubics(
        table, low_degC=low, high_degC=high, reference_degC=reference, constant=autopilot == PX4
    )
    coefficients = np.stack([fit.coefficients for fit in fits])
    if autopilot == ARDUPILOT:
        coefficients[:, 0] = 0.0
    cubic = AutopilotCubic(
        autopilot=autopilot,
        number=number,
        low_degC=low,
        high_degC=high,
        reference_degC=reference,
        coefficients=coefficients,
        device_id=device_id,
    )
    too_stiff = tuple(
        f"{fit.words()}, needed {limit_sigmas:g} sigma at most"
        for fit in fits
        if fit.worst_sigmas > limit_sigmas
    )
    return CubicExport(
        cubic=cubic,
        fits=fits,
        rounding_deg_h=cubic.rounding_deg_h(),
        limit_sigmas=limit_sigmas,
        too_stiff=too_stiff,
    )


def _shared_nodes(table: ThermalTable) -> tuple[float, float]:
    """Lowest and highest temperature that all three axes have nodes for."""
    return max(float(t[0]) for t in table.temperature_degC), min(
        float(t[-1]) for t in table.temperature_degC
    )


@dataclass(frozen=True)
class ParameterFile:
    """The file that parameters came from, as the table's provenance names it."""

    name: str = ""
    sha256: str = ""


def table_of_cubic(
    cubic: AutopilotCubic,
    *,
    imu_serial: str,
    gyro_technology: str,
    created_utc: str,
    gyro_mode: str = "",
    sigma_deg_h: float | None = None,
    file: ParameterFile | None = None,
) -> tuple[ThermalTable, list[str]]:
    """The parameters as a Hermite table (a cubic needs no more), and notes on its sigma.

    Sigma: as given or that of one calibration, the table's that the file states where that is
    larger; and with it, as errors of their own, what the file says that its cubic is off that
    table.
    """
    count = max(2, int(np.ceil((cubic.high_degC - cubic.low_degC) / SPACING_DEGC)) + 1)
    nodes = np.linspace(cubic.low_degC, cubic.high_degC, count)
    slope = np.polynomial.polynomial.polyder(cubic.coefficients.T)
    slopes = np.polynomial.polynomial.polyval(nodes - cubic.reference_degC, slope).T
    sigma, why = (
        (sigma_deg_h, "as given") if sigma_deg_h is not None else _sigma(cubic, gyro_technology)
    )
    relative = cubic.autopilot == ARDUPILOT
    own = sigma * np.sqrt(1.0 - COMMON_FRACTION) if relative else sigma
    P = _covariance(cubic, nodes, own)
    notes = [f"sigma {sigma:.3g} deg/h, {why}"]
    if relative:
        for axis in range(3):
            values = slice(axis * count, (axis + 1) * count)
            P[values, values] += FREE_LEVEL_DEG_H**2
        notes = [
            (
                f"the shape over temperature is known to {own:.3g} deg/h, 30 % of the variance of"
                f" {sigma:.3g} deg/h, {why}"
            ),
            (
                "no constant in the file: the table is relative (0 at 35 degC), its level +-"
                f" {FREE_LEVEL_DEG_H:g} deg/h (1 deg/s, a usual zero-rate offset)"
            ),
        ]
    notes += _stated(cubic, own)
    file = file or ParameterFile()
    origin = {
        "autopilot": cubic.autopilot,
        "imu": cubic.number,
        "device_id": cubic.device_id,
        "file": file.name,
        "file_sha256": file.sha256,
        "relative": relative,
    }
    table = ThermalTable(
        imu_serial=imu_serial,
        gyro_technology=gyro_technology,
        gyro_mode=gyro_mode,
        created_utc=created_utc,
        interpolation="hermite",
        temperature_degC=(nodes, nodes, nodes),
        covariance=P,
        parameters=np.concatenate([cubic.offset_deg_h(nodes).T.ravel(), slopes.T.ravel()]),
        provenance={"parent_sha256": None, "runs": [], "imported_from": origin},
    )
    return table, notes


def _covariance(cubic: AutopilotCubic, nodes: NDArray, own_deg_h: float) -> NDArray:
    """Of the imported values and slopes; the cubic's own misfit changes sign faster than any drift
    of a gyro.
    """
    relative, count = cubic.autopilot == ARDUPILOT, nodes.size

    def each(sigma: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        return np.full(count, sigma[0]), np.full(count, sigma[1]), np.full(count, sigma[2])

    gyros = each(np.maximum(own_deg_h, cubic.stated_sigma_deg_h))
    P = prior_covariance(
        (nodes,) * 3, gyros, hermite=True, common_fraction=0.0 if relative else COMMON_FRACTION
    )
    length = MISFIT_LENGTH * (cubic.high_degC - cubic.low_degC)
    misfit = each(cubic.stated_error_deg_h)
    return P + prior_covariance(
        (nodes,) * 3, misfit, hermite=True, common_fraction=0.0, length_degC=length
    )


def _stated(cubic: AutopilotCubic, own_deg_h: float) -> list[str]:
    """What the file's comments made of the sigma."""

    def listed(values: NDArray) -> str:
        return ", ".join(f"{axis} {value:.3g}" for axis, value in zip(AXES, values))

    notes, error, sigma = [], cubic.stated_error_deg_h, cubic.stated_sigma_deg_h
    if (sigma > own_deg_h).any():
        notes.append(
            f"the file states a table sigma of {listed(sigma)} deg/h: taken where it is larger"
        )
    if (error > 0).any():
        notes.append(
            f"widened by what the file states that its cubic is off the table: {listed(error)}"
            " deg/h at most"
        )
    return notes


def _sigma(cubic: AutopilotCubic, technology: str) -> tuple[float, str]:
    """Sigma of one autopilot calibration: one power-on, Earth rate left in, on an unknown
    heading.
    """
    turn_on = default_twin(technology).gyro.turn_on_deg_h
    earth = EARTH_RATE_RAD_S / DEG_PER_HOUR / np.sqrt(3.0)
    why = "that of" if cubic.stated_sigma_deg_h.any() else "since the file states none:"
    why += (
        f" one calibration, which holds one turn-on ({turn_on:g} deg/h, defaults of {technology})"
        f" and the Earth rate that {TITLES[cubic.autopilot]}'s fit leaves in ({earth:.1f} deg/h an"
        " axis); --sigma sets another"
    )
    return float(np.hypot(turn_on, earth)), why
