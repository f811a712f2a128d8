"""The records that pass between packages: frozen, checked once, arrays float64 and read-only.

Times are seconds from the run's start; SI units and radians unless the name says otherwise.

Decision: docs/decisions/0005-imu-source.md.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from datetime import datetime, timedelta
from enum import IntEnum, StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NotRequired, Protocol, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ins.columns import (
    ACCEL_DEGC,
    ATTITUDE,
    FIX_SIGMA_COLUMNS,
    GRADIENT_DEGC,
    GYRO_DEGC,
    INCREMENT_COLUMNS,
    Stream,
    degrees_exact,
    given,
    place,
    spread,
    stream_size,
)
from ins.columns import AXES as AXES
from ins.units import DEG
from ins.verdicts import Reason, sentence

if TYPE_CHECKING:
    import pandas as pd

GYRO_TECHNOLOGIES = ("rlg", "fog", "mems")
PHASES = ("alignment", "extended_alignment", "taxi", "takeoff", "flight", "landing", "parked")
PARKED_PHASES = ("alignment", "extended_alignment", "parked")  # those in which the vehicle stands
AIRBORNE_PHASES = ("takeoff", "flight", "landing")
LONGEST_NAME = 200  # characters; chosen: twice a run_id of 100, a serial has some 20
PIECE_ROWS = 1 << 16  # of a log that is worked on in pieces
CLOCK_AHEAD = timedelta(days=1)  # of a start: local time taken for UTC is up to 14 h ahead


class Refusal(RuntimeError):
    """What was asked for was not done, though the input was right: exit code 4.

    Nothing was written.
    """


class InputError(ValueError):
    """Bad input, said in one line (exit code 3).

    The line names file, row or key, what was got and what was needed.

    Parameters
    ----------
    line : str
    more : sequence of str
        Lines that follow it on a terminal, such as what there is to choose from.
    """

    def __init__(self, line: str = "", more: Sequence[str] = ()) -> None:
        super().__init__(line)
        self.more = tuple(more)


def check_name(key: str, text: str) -> None:
    """Refuse what is no name of a unit, run or mode.

    Parameters
    ----------
    key : str
        What the text stands for; the error line begins with it.
    text : str
        May be empty.

    Raises
    ------
    InputError
        On line ends, control characters and marks of direction, which would forge lines of a
        report, and on more than LONGEST_NAME characters.
    """
    if not text.isprintable() or len(text) > LONGEST_NAME:
        raise InputError(
            f"{key}: got {text[:40]!r}, needed at most {LONGEST_NAME} printable characters on one"
            " line"
        )


def frozen_array(values: ArrayLike, shape: tuple[int | None, ...], name: str) -> NDArray:
    """A read-only, C-ordered copy in float64, its shape checked.

    Parameters
    ----------
    values : array_like
        Any numbers.
    shape : tuple of int or None
        Lengths that are needed; None: any length.
    name : str
        What the error line calls it.

    Returns
    -------
    array : ndarray of float64

    Raises
    ------
    InputError
        On another shape.

    Examples
    --------
    >>> frozen_array([1, 2], (None,), "time_s")
    array([1., 2.])
    """
    if isinstance(values, np.ndarray) and _is_settled(values):
        a = values
    else:
        a = np.array(values, dtype=np.float64, order="C")
    if a.ndim != len(shape) or any(
        want is not None and got != want for got, want in zip(a.shape, shape)
    ):
        raise InputError(f"{name}: shape {a.shape}, needed {shape}")
    a.flags.writeable = False
    return a


def _is_settled(values: NDArray) -> bool:
    """Whether an array is what a record holds already: nobody can write to it, and it owns its
    numbers, so that a long log need not be copied.
    """
    owned = values.base is None and not values.flags.writeable
    return owned and values.dtype == np.float64 and values.flags.c_contiguous


def _freeze(record: Any, shapes: dict[str, tuple[int | None, ...]]) -> None:
    for name, shape in shapes.items():
        value = getattr(record, name)
        if value is not None:
            object.__setattr__(
                record, name, frozen_array(value, shape, f"{type(record).__name__}.{name}")
            )


# of a latitude that was given, at least: 111 m, and 0.0002 deg/h of the vertical gyro
LEAST_SIGMA_LAT_RAD = 0.001 * DEG


class LatitudeSource(StrEnum):
    """Who says the latitude of a run."""

    RECEIVER = "receiver"
    GIVEN = "given"
    GUESS = "guess"


@dataclass(frozen=True, kw_only=True)
class Site:
    """A geodetic position, WGS-84, and how well its latitude is known.

    Parameters
    ----------
    lat_rad : float
        Within +-pi/2.
    lon_rad : float
        Within +-2 pi.
    height_m : float
        Above the ellipsoid, -1000 to 30000 m.
    sigma_lat_rad : float
        Of the latitude: 0.01 deg is 0.0018 deg/h on the vertical gyro at 48 deg.
    lat_source : LatitudeSource

    Raises
    ------
    InputError
        Beyond these bounds.
    """

    lat_rad: float
    lon_rad: float
    height_m: float
    sigma_lat_rad: float = LEAST_SIGMA_LAT_RAD
    lat_source: LatitudeSource = LatitudeSource.GIVEN

    def __post_init__(self) -> None:
        if not 0.0 <= self.sigma_lat_rad < np.inf:
            raise InputError(f"sigma of latitude {self.sigma_lat_rad:.6g} rad, needed 0 or more")
        if not abs(self.lat_rad) <= np.pi / 2:
            raise InputError(f"latitude {np.degrees(self.lat_rad):.6g} deg, needed within +-90 deg")
        if not abs(self.lon_rad) <= 2 * np.pi:
            raise InputError(
                f"longitude {np.degrees(self.lon_rad):.6g} deg, needed within +-360 deg"
            )
        if not -1000.0 <= self.height_m <= 30000.0:
            raise InputError(f"height {self.height_m:.6g} m, needed -1000 to 30000 m")


@dataclass(frozen=True, kw_only=True)
class Span:
    """A stretch of time and why it is named: excluded, repaired, left out by an estimator.

    Parameters
    ----------
    start_s, end_s : float
        Seconds from the run's start.
    reason : Reason or str
    run_id : str, optional
        Where several runs share a list.
    """

    start_s: float
    end_s: float
    reason: Reason | str
    run_id: str | None = field(default=None, metadata={"omit_none": True})  # of `ins.documents`

    def in_words(self, run_id: str | None = None) -> "Span":
        """The stretch as documents have it.

        Parameters
        ----------
        run_id : str, optional
            Where several runs share the list.

        Returns
        -------
        span : Span
        """
        words = self.reason if isinstance(self.reason, str) else sentence(self.reason)
        return replace(self, reason=str(words), run_id=run_id)


@dataclass(frozen=True, kw_only=True, repr=False)
class ImuLog(Stream):
    """Inertial increments: row k is the change over the `dt_s[k]` that end at `time_s[k]`.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Two or more, strictly increasing.
    dt_s : ndarray, shape (n,)
        Intervals; `dt_s[0]` is the nominal one.
    dtheta_rad, dv_m_s : ndarray, shape (n, 3)
        Changes of angle and velocity in body axes: x forward, y right, z down.
    source : str
        "increments" or "rates": what the file held.

    Raises
    ------
    InputError
        Columns that differ in length, times that do not increase.
    """

    time_s: NDArray
    dt_s: NDArray
    dtheta_rad: NDArray
    dv_m_s: NDArray
    source: str = "increments"

    def __post_init__(self) -> None:
        _freeze(
            self, {"time_s": (None,), "dt_s": (None,), "dtheta_rad": (None, 3), "dv_m_s": (None, 3)}
        )
        if self.time_s.size < 2 or not np.all(np.diff(self.time_s) > 0):
            raise InputError("ImuLog: needs at least two rows with strictly increasing time_s")
        if not (
            self.dt_s.shape == self.time_s.shape
            and len(self.dtheta_rad) == len(self.dv_m_s) == self.time_s.size
        ):
            raise InputError("ImuLog: columns differ in length")

    @property
    def rate_hz(self) -> float:
        """Nominal sample rate: one over the median interval."""
        return float(1.0 / np.median(np.diff(self.time_s)))

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.time_s.size)

    @property
    def start_s(self) -> float:
        """Time of the first row."""
        return float(self.time_s[0])

    @property
    def end_s(self) -> float:
        """Time of the last row."""
        return float(self.time_s[-1])

    def whole(self) -> "ImuLog":
        """All rows.

        Returns
        -------
        imu : ImuLog
            The log itself.
        """
        return self

    def columns(self) -> dict[str, NDArray]:
        """The increments as columns of an imu file.

        Returns
        -------
        columns : dict of ndarray, shape (n,)
        """
        increments = np.hstack([self.dtheta_rad, self.dv_m_s])
        return {"time_s": self.time_s, **spread(INCREMENT_COLUMNS, increments)}

    def pieces(self, start_s: float = -np.inf, end_s: float = np.inf) -> Iterator["ImuLog"]:
        """The rows of `between` in logs of some ten thousand rows.

        Parameters
        ----------
        start_s, end_s : float
            The span (start_s, end_s].

        Returns
        -------
        pieces : iterator of ImuLog
            Each of two or more rows; none where there is no row.
        """
        a, b = (int(k) for k in np.searchsorted(self.time_s, [start_s, end_s], side="right"))
        edges = [*range(a, max(b - 1, a + 1), PIECE_ROWS), b]
        for first, last in pairwise(edges if b > a else ()):
            yield self._part(slice(first, last))

    def between(self, start_s: float, end_s: float) -> "ImuLog":
        """The rows whose interval ends in a span.

        Parameters
        ----------
        start_s, end_s : float
            The span (start_s, end_s].

        Returns
        -------
        imu : ImuLog

        Raises
        ------
        InputError
            Where the span holds fewer than two rows.
        """
        return self._part(slice(*np.searchsorted(self.time_s, [start_s, end_s], side="right")))

    def _part(self, rows: slice) -> "ImuLog":
        return ImuLog(
            time_s=self.time_s[rows],
            dt_s=self.dt_s[rows],
            dtheta_rad=self.dtheta_rad[rows],
            dv_m_s=self.dv_m_s[rows],
            source=self.source,
        )


class ImuSource(Protocol):
    """The increments of a run, in memory (`ImuLog`) or left in their file and read piece by piece.

    Whatever is done piece after piece needs the memory of a piece, however long the run is.
    """

    @property
    def source(self) -> str:
        """ "increments" or "rates": what the file held."""

    @property
    def rows(self) -> int:
        """Number of rows."""

    @property
    def start_s(self) -> float:
        """Time of the first row."""

    @property
    def end_s(self) -> float:
        """Time of the last row."""

    @property
    def rate_hz(self) -> float:
        """Nominal sample rate: one over the median interval."""

    def between(self, start_s: float, end_s: float) -> ImuLog:
        """The rows whose interval ends in a span, in memory.

        Parameters
        ----------
        start_s, end_s : float
            The span (start_s, end_s].

        Returns
        -------
        imu : ImuLog
        """

    def pieces(self, start_s: float = -np.inf, end_s: float = np.inf) -> Iterator[ImuLog]:
        """The same rows in logs of some ten thousand rows.

        Parameters
        ----------
        start_s, end_s : float
            The span (start_s, end_s].

        Returns
        -------
        pieces : iterator of ImuLog
            Each of two or more rows; none where there is no row.
        """

    def whole(self) -> ImuLog:
        """All rows, in memory.

        Returns
        -------
        imu : ImuLog
        """


@dataclass(frozen=True, kw_only=True, repr=False)
class TemperatureLog(Stream):
    """Temperatures of a run; those that are not logged are None.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
    gyro_degC, accel_degC : ndarray, shape (n, 3)
        Of each sensor of the triad; those of the gyros are required.
    block_degC, ambient_degC : ndarray, shape (n,)
        Of the sensor block; of the air around the unit.
    gradient_degC : ndarray, shape (n, 3)
        Difference across each gyro.
    constant : bool
        One that never changes is accepted as a constant temperature.
    """

    time_s: NDArray
    gyro_degC: NDArray
    accel_degC: NDArray | None = None
    block_degC: NDArray | None = None
    gradient_degC: NDArray | None = None
    ambient_degC: NDArray | None = None
    constant: bool = False

    def __post_init__(self) -> None:
        n = (None,)
        _freeze(
            self,
            {
                "time_s": n,
                "gyro_degC": (None, 3),
                "accel_degC": (None, 3),
                "block_degC": n,
                "gradient_degC": (None, 3),
                "ambient_degC": n,
            },
        )

    def columns(self) -> dict[str, NDArray]:
        """The temperatures that are there, as columns of a temperature file.

        Returns
        -------
        columns : dict of ndarray, shape (n,)
        """
        return {
            "time_s": self.time_s,
            **spread(GYRO_DEGC, self.gyro_degC),
            **spread(ACCEL_DEGC, self.accel_degC),
            **given(block_degC=self.block_degC),
            **spread(GRADIENT_DEGC, self.gradient_degC),
            **given(ambient_degC=self.ambient_degC),
        }


class FixType(IntEnum):
    """How a satellite fix was computed, by the numbers of MAVLink's GPS_FIX_TYPE.

    SINGLE: by codes alone; DIFFERENTIAL: with corrections; FLOAT: by carrier phases; FIXED: with
    their whole numbers known.
    """

    SINGLE = 3
    DIFFERENTIAL = 4
    FLOAT = 5
    FIXED = 6


@dataclass(frozen=True, kw_only=True, repr=False)
class GnssLog(Stream):
    """Satellite fixes; sigmas are None where the file has none.

    Parameters
    ----------
    time_s, lat_rad, lon_rad, height_m : ndarray, shape (n,)
        Position of the antenna, height above the ellipsoid.
    v_n_m_s : ndarray, shape (n, 3)
        Velocity, NED.
    sigma_horizontal_m, sigma_vertical_m, sigma_velocity_m_s : ndarray, shape (n,), optional
        As the receiver states them, one component each.
    fix_type : ndarray, shape (n,), optional
        `FixType` of each fix; NaN where it is unknown.
    """

    time_s: NDArray
    lat_rad: NDArray
    lon_rad: NDArray
    height_m: NDArray
    v_n_m_s: NDArray
    sigma_horizontal_m: NDArray | None = None
    sigma_vertical_m: NDArray | None = None
    sigma_velocity_m_s: NDArray | None = None
    fix_type: NDArray | None = None

    def __post_init__(self) -> None:
        one = dict.fromkeys((f.name for f in fields(self)), (None,))
        _freeze(self, {**one, "v_n_m_s": (None, 3)})

    def columns(self) -> dict[str, NDArray]:
        """The fixes as columns of a gnss file; sigmas and types where the log has them.

        Returns
        -------
        columns : dict of ndarray, shape (n,)
        """
        return {
            "time_s": self.time_s,
            **place(self.lat_rad, self.lon_rad, self.height_m, self.v_n_m_s),
            **given(**{name: getattr(self, name) for name in FIX_SIGMA_COLUMNS}),
            **given(fix_type=self.fix_type),
        }


@dataclass(frozen=True, kw_only=True, repr=False)
class OdometerLog(Stream):
    """Speed along body x at the wheel reference point.

    Parameters
    ----------
    time_s, speed_m_s : ndarray, shape (n,)
    """

    time_s: NDArray
    speed_m_s: NDArray

    def __post_init__(self) -> None:
        _freeze(self, {"time_s": (None,), "speed_m_s": (None,)})

    def columns(self) -> dict[str, NDArray]:
        """The speeds as columns of an odometer file.

        Returns
        -------
        columns : dict of ndarray, shape (n,)
        """
        return {"time_s": self.time_s, "speed_m_s": self.speed_m_s}


@dataclass(frozen=True, kw_only=True)
class Phase:
    """A phase of the run, as logged or detected.

    Parameters
    ----------
    phase : str
        One of PHASES.
    start_s, end_s : float
        End after start.

    Raises
    ------
    InputError
        Another phase; an end before the start.
    """

    phase: str
    start_s: float
    end_s: float

    def __post_init__(self) -> None:
        if self.phase not in PHASES:
            raise InputError(f"phase {self.phase!r}, needed one of {', '.join(PHASES)}")
        if not self.end_s > self.start_s:
            raise InputError(
                f"phase {self.phase}: ends at {self.end_s} s, before it starts at {self.start_s} s"
            )


@dataclass(frozen=True, kw_only=True, repr=False)
class ReferenceLog(Stream):
    """Truth, for scoring only: it is never handed to an estimator.

    Parameters
    ----------
    time_s, lat_rad, lon_rad, height_m : ndarray, shape (n,)
    v_n_m_s : ndarray, shape (n, 3)
        Velocity, NED.
    roll_rad, pitch_rad, heading_rad : ndarray, shape (n,)
    """

    time_s: NDArray
    lat_rad: NDArray
    lon_rad: NDArray
    height_m: NDArray
    v_n_m_s: NDArray
    roll_rad: NDArray
    pitch_rad: NDArray
    heading_rad: NDArray

    def __post_init__(self) -> None:
        one = dict.fromkeys((f.name for f in fields(self)), (None,))
        _freeze(self, {**one, "v_n_m_s": (None, 3)})

    def columns(self) -> dict[str, NDArray]:
        """The truth as columns of a reference file.

        Returns
        -------
        columns : dict of ndarray, shape (n,)
        """
        angles = (self.roll_rad, self.pitch_rad, self.heading_rad)
        return {
            "time_s": self.time_s,
            **place(self.lat_rad, self.lon_rad, self.height_m, self.v_n_m_s),
            **dict(zip(ATTITUDE, map(degrees_exact, angles))),
        }


@dataclass(frozen=True, kw_only=True)
class Survey:
    """Surveyed parked heading and taxi centre line, each None or with its sigma.

    Parameters
    ----------
    heading_rad, sigma_heading_rad : float, optional
    centre_line_rad, sigma_centre_line_rad : float, optional
    """

    heading_rad: float | None = None
    sigma_heading_rad: float | None = None
    centre_line_rad: float | None = None
    sigma_centre_line_rad: float | None = None


@dataclass(frozen=True, kw_only=True)
class RemovedModel:
    """A thermal model that was taken out of a run's gyro output.

    Parameters
    ----------
    sha256 : str
        Hash of the model's file.
    part : str
        What was taken out: "all" or "rates".
    run_sha256 : str
        Hash of the raw run.
    """

    sha256: str
    part: str
    run_sha256: str


@dataclass(frozen=True, kw_only=True)
class RunHeader:
    """What run.json says (formats.md, section 1).

    Parameters
    ----------
    run_id, tail, imu_serial : str
    gyro_technology : str
        One of GYRO_TECHNOLOGIES.
    start_utc : str
        ISO 8601.
    site : Site
        Where the run starts.
    wheel_reference_m, gnss_lever_arm_m : (float, float, float)
        From the IMU, body axes.
    applied_table_sha256 : str, optional
        The thermal table that the unit applied itself.
    gyro_mode : str
    survey : Survey
    removed_model : RemovedModel, optional
        None where the gyro output holds its thermal bias.
    level_removed : bool
        A constant of this session, such as an autopilot's start-up offsets, was subtracted from the
        rates.
    accepted_accel_scale : float
        What the accelerometers' scales may be off by, where whoever made the log accepts that.
    accepted_constant_temperature : bool
        Thermometers that never change are accepted as such.
    any_attitude : bool
        The unit may stand in any attitude, also upside down.

    Raises
    ------
    InputError
        On another technology, and on names of more than one line.
    """

    run_id: str
    tail: str
    imu_serial: str
    gyro_technology: str
    start_utc: str
    site: Site
    wheel_reference_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gnss_lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    applied_table_sha256: str | None = None
    gyro_mode: str = ""
    survey: Survey = field(default_factory=Survey)
    removed_model: RemovedModel | None = None
    level_removed: bool = False
    accepted_accel_scale: float = 0.0
    accepted_constant_temperature: bool = False
    any_attitude: bool = False

    def __post_init__(self) -> None:
        if self.gyro_technology not in GYRO_TECHNOLOGIES:
            raise InputError(
                f"gyro_technology {self.gyro_technology!r}, needed one of"
                f" {', '.join(GYRO_TECHNOLOGIES)}"
            )
        for key in ("run_id", "tail", "imu_serial", "gyro_mode"):
            check_name(key, getattr(self, key))

    def starts_after(self, now: datetime) -> bool:
        """Whether the run starts in the future, by more than clocks and time zones explain.

        Parameters
        ----------
        now : datetime
            With a time zone.

        Returns
        -------
        later : bool
            By more than CLOCK_AHEAD.
        """
        return datetime.fromisoformat(self.start_utc) > now + CLOCK_AHEAD


@dataclass(frozen=True, kw_only=True, repr=False)
class Run:
    """One power-on session: everything that an estimator may see.

    Parameters
    ----------
    header : RunHeader
    imu : ImuSource
    temperature : TemperatureLog, optional
    gnss : GnssLog, optional
    odometer : OdometerLog, optional
    phases : tuple of Phase
        Empty where the run has no such stream.
    sha256 : str
        Over the content of run.json and all streams but `reference`.
    faults : tuple of Span
        What was dropped or repaired while reading.
    """

    header: RunHeader
    imu: ImuSource
    temperature: TemperatureLog | None = None
    gnss: GnssLog | None = None
    odometer: OdometerLog | None = None
    phases: tuple[Phase, ...] = ()
    sha256: str = ""
    faults: tuple[Span, ...] = ()

    def to_frame(self) -> "pd.DataFrame":
        """The inertial increments as a table of pandas; the other streams have one of their own.

        Returns
        -------
        table : pandas.DataFrame
            Index and columns as `Stream.to_frame`. A stream that was left in its file is read
            whole.
        """
        return self.imu.whole().to_frame()

    def __repr__(self) -> str:
        header, imu = self.header, self.imu
        lines = [
            f"Run {header.run_id!r}: unit {header.imu_serial} ({header.gyro_technology}),"
            f" started {header.start_utc}",
            f"  imu: {imu.rows} rows, {imu.start_s:.6g} to {imu.end_s:.6g} s, {imu.rate_hz:.4g} Hz,"
            f" {imu.source}",
        ]
        for name in ("temperature", "gnss", "odometer"):
            log = getattr(self, name)
            if log is not None:
                lines.append(f"  {name}: {stream_size(log.time_s)}")
        if self.phases:
            lines.append(f"  phases: {', '.join(phase.phase for phase in self.phases)}")
        if self.faults:
            lines.append(f"  faults: {len(self.faults)} spans dropped or repaired")
        return "\n".join(lines)


@dataclass(frozen=True, kw_only=True)
class NavState:
    """A navigation state.

    Parameters
    ----------
    time_s : float
    site : Site
        Position.
    v_n_m_s : ndarray, shape (3,)
        Velocity relative to Earth, NED.
    C_nb : ndarray, shape (3, 3)
        Attitude: takes body components into NED.
    """

    time_s: float
    site: Site
    v_n_m_s: NDArray
    C_nb: NDArray

    def __post_init__(self) -> None:
        _freeze(self, {"v_n_m_s": (3,), "C_nb": (3, 3)})


@dataclass(frozen=True, kw_only=True)
class NavHistory:
    """A navigation solution at epoch ends, with what each epoch accumulated.

    Row k is over the epoch that ends at time_s[k]. Row 0 is the initial state, its accumulations
    zero.

    Parameters
    ----------
    time_s, lat_rad, lon_rad, height_m : ndarray, shape (k,)
    v_n_m_s : ndarray, shape (k, 3)
    C_nb : ndarray, shape (k, 3, 3)
    C_nb_dt : ndarray, shape (k, 3, 3)
        Integral of C_nb [s].
    displacement_n_m, displacement_b_m : ndarray, shape (k, 3)
        Integrals of v_n and of C_bn v_n.
    dv_f_n_m_s : ndarray, shape (k, 3)
        Integral of C_nb f.
    dtheta_b_rad : ndarray, shape (k, 3)
        Sum of the gyro increments used.
    """

    time_s: NDArray
    lat_rad: NDArray
    lon_rad: NDArray
    height_m: NDArray
    v_n_m_s: NDArray
    C_nb: NDArray
    C_nb_dt: NDArray
    displacement_n_m: NDArray
    displacement_b_m: NDArray
    dv_f_n_m_s: NDArray
    dtheta_b_rad: NDArray

    def __post_init__(self) -> None:
        one = dict.fromkeys(("time_s", "lat_rad", "lon_rad", "height_m"), (None,))
        vector = dict.fromkeys(
            ("v_n_m_s", "displacement_n_m", "displacement_b_m", "dv_f_n_m_s", "dtheta_b_rad"),
            (None, 3),
        )
        _freeze(self, {**one, **vector, "C_nb": (None, 3, 3), "C_nb_dt": (None, 3, 3)})


@dataclass(frozen=True, kw_only=True)
class GyroNoise:
    """A gyro triad as its twin declares it (formats.md, section 3).

    Parameters
    ----------
    arw_deg_sqrt_h : float
        Angle random walk.
    bias_instability_deg_h : float
        Flicker B.
    rate_random_walk_deg_h_sqrt_h : float
    turn_on_deg_h : float
        Spread of the bias from one power-on to the next.
    scale_factor_ppm : (float, float, float)
    misalignment_mrad, sigma_misalignment_mrad : tuple of 6 floats
        [xy, xz, yx, yz, zx, zy], and their sigmas (0: not measured).
    quantization_rad : float
        Of the accumulated angle.
    """

    arw_deg_sqrt_h: float = 0.002
    bias_instability_deg_h: float = 0.002
    rate_random_walk_deg_h_sqrt_h: float = 0.002
    turn_on_deg_h: float = 0.003
    scale_factor_ppm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    misalignment_mrad: tuple[float, float, float, float, float, float] = (0.0,) * 6
    # 0: not measured
    sigma_misalignment_mrad: tuple[float, float, float, float, float, float] = (0.0,) * 6
    quantization_rad: float = 0.0


@dataclass(frozen=True, kw_only=True)
class AccelNoise:
    """An accelerometer triad as its twin declares it (formats.md, section 3).

    Parameters
    ----------
    vrw_ug_sqrt_hz : float
        Velocity random walk.
    bias_ug : (float, float, float)
    bias_instability_ug : float
        Flicker B.
    rate_random_walk_ug_sqrt_h : float
    turn_on_ug : float
        Spread of the bias from one power-on to the next.
    quantization_m_s : float
        Of the accumulated velocity.
    """

    vrw_ug_sqrt_hz: float = 10.0
    bias_ug: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bias_instability_ug: float = 1.0
    rate_random_walk_ug_sqrt_h: float = 2.0
    turn_on_ug: float = 30.0
    quantization_m_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class TemperatureNoise:
    """Thermometers as the twin declares them (formats.md, section 3).

    Parameters
    ----------
    noise_degC, resolution_degC : float
    """

    noise_degC: float = 0.01
    resolution_degC: float = 0.01


@dataclass(frozen=True, kw_only=True)
class GnssNoise:
    """A satellite receiver as the twin declares it (formats.md, section 3), one component.

    Parameters
    ----------
    sigma_horizontal_m, sigma_vertical_m, sigma_velocity_m_s : float
    """

    sigma_horizontal_m: float = 0.5
    sigma_vertical_m: float = 0.75
    sigma_velocity_m_s: float = 0.03


@dataclass(frozen=True, kw_only=True)
class OdometerNoise:
    """An odometer as the twin declares it (formats.md, section 3).

    Parameters
    ----------
    scale_ppm : float
        Scale error, positive where it reads high.
    noise_m_s : float
    """

    scale_ppm: float = 0.0
    noise_m_s: float = 0.01


@dataclass(frozen=True, kw_only=True)
class VehicleNoise:
    """How the vehicle moves that should stand or roll straight (formats.md, section 3).

    Parameters
    ----------
    crab_mrad : float
        Angle between the body's x axis and the way it rolls.
    lateral_noise_m_s : float
        RMS of side velocity while it rolls.
    yaw_creep_arcsec_sqrt_h : float
        Random walk of the parked heading.
    sway_m_s, sway_hz, sway_damping : float
        RMS velocity, frequency and damping ratio of the parked vehicle's sway.
    """

    crab_mrad: float = 0.0
    lateral_noise_m_s: float = 0.02
    yaw_creep_arcsec_sqrt_h: float = 3.0
    sway_m_s: float = 0.001
    sway_hz: float = 0.28
    sway_damping: float = 0.2


ParameterValue = float | str | list[float] | list[str] | dict[str, float | str]


class EffectDocument(TypedDict):
    """An effect of a twin as its file holds it (docs, the twin): name, target, parameters.

    sigma: one standard deviation of those that were found by a diagnosis.
    """

    effect: str
    target: str
    parameters: dict[str, ParameterValue]
    sigma: NotRequired[dict[str, float]]


class FitDocument(TypedDict, total=False):
    """What a fitted twin rests on, as its file holds it (formats.md, section 6).

    parameters: names, section and key, with values, sigma and interval_95 of each and their
    covariance; identified: whether the runs tell it; seconds: at rest behind it; needed_s: parked
    in one recording that would tell it, null where none of 128 h does; needed_runs: for the
    turn-on; not_identified: why, by name; lines: of dither and engines, left out of the noise;
    axes: of channels whose triad is unlike, variances over the twin's; read_below_hz: of a triad
    ("gyro", "accel") whose rows a filter has smoothed, how far up they are the twin's; runs:
    hashes; method: how.
    """

    parameters: list[str]
    values: list[float]
    sigma: list[float | None]
    interval_95: list[list[float | None]]
    covariance: list[list[float]]
    identified: list[bool]
    seconds: list[float]
    needed_s: list[float | None]
    needed_runs: list[float | None]
    not_identified: dict[str, str]
    lines: list[dict[str, float | str]]
    axes: list[dict[str, float | str]]
    read_below_hz: dict[str, float]
    runs: list[str]
    method: str


@dataclass(frozen=True, kw_only=True)
class TwinModel:
    """What is believed about one installation: noise and nominal errors.

    Parameters
    ----------
    imu_serial, gyro_technology : str
    table : str, optional
        Path as written in the file; None: no table.
    gyro : GyroNoise
    accel : AccelNoise
    temperature : TemperatureNoise
    gnss : GnssNoise
    odometer : OdometerNoise
    vehicle : VehicleNoise
    effects : tuple of EffectDocument
        Effects beyond these, by name, target and parameters.
    fit : FitDocument, optional
        What the numbers rest on, where they were fitted to runs.
    source : str
        Where the numbers come from: a file, or the defaults of a technology.
    """

    imu_serial: str = ""
    gyro_technology: str = "rlg"
    table: str | None = None
    gyro: GyroNoise = field(default_factory=GyroNoise)
    accel: AccelNoise = field(default_factory=AccelNoise)
    temperature: TemperatureNoise = field(default_factory=TemperatureNoise)
    gnss: GnssNoise = field(default_factory=GnssNoise)
    odometer: OdometerNoise = field(default_factory=OdometerNoise)
    vehicle: VehicleNoise = field(default_factory=VehicleNoise)
    effects: tuple[EffectDocument, ...] = ()
    fit: FitDocument | None = None
    source: str = "defaults"


class AxisDocument(TypedDict):
    """One gyro of a table as written; slopes with hermite interpolation only."""

    temperature_degC: list[float]
    bias_deg_h: list[float]
    sigma_deg_h: list[float]
    slope_deg_h_degC: NotRequired[list[float]]


class TableDocument(TypedDict):
    """A thermal table as written (recal.table/1), kept so that its hash stays what it was.

    What is read of it becomes a record (`infield.table.file.table_from_dict`); provenance: what
    whoever made it says of it.
    """

    schema: str
    imu_serial: str
    gyro_technology: str
    gyro_mode: NotRequired[str]
    created_utc: str
    interpolation: str
    axes: dict[str, AxisDocument]
    covariance: NotRequired[list[list[float]] | None]
    provenance: NotRequired[dict[str, Any]]
