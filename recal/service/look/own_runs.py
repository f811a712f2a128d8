"""`recal.Run`: a run with its page and its plot, made of arrays, of a table of pandas, or read from
its directory.
"""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, fields
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from infield.reports.page import render_page
from ins import records
from ins.columns import GYRO_DEGC, spread
from ins.documents import to_json
from ins.records import GnssLog, InputError
from recal.service.look.series import series_of
from recal.service.results.files import AnyPath, write_text
from recal.service.results.plots import figure_of
from trajectories.readers.columns.imu_columns import second_means
from trajectories.readers.columns.named_columns import frame_arrays
from trajectories.runs import directory, schema
from trajectories.runs.stream_files import write_columns

if TYPE_CHECKING:
    import pandas as pd
    from plotly.graph_objects import Figure

ALL_ROWS = 1 << 62  # of a run that stays in memory
Columns = Mapping[str, ArrayLike]


@dataclass(frozen=True, kw_only=True, repr=False)
class Run(records.Run):
    """One power-on session: what `recal.read_run` reads, or what arrays hold.

    Every verb takes it in the place of a run directory.

    Examples
    --------
    >>> import recal
    >>> simulated = recal.simulate("cold_parked_taxi", seed=7, rate_hz=20)
    >>> recal.Run.of(simulated.run).header.imu_serial
    'SN-0042'
    """

    @classmethod
    def of(cls, run: records.Run) -> Self:
        """A run of another part of the program as one with a page.

        Parameters
        ----------
        run : ins.records.Run

        Returns
        -------
        Run
        """
        return cls(**{f.name: getattr(run, f.name) for f in fields(records.Run)})

    @classmethod
    def from_arrays(  # noqa: PLR0913 - a contract, formats.md
        cls,
        time_s: ArrayLike,
        gyro_rad_s: ArrayLike,
        accel_m_s2: ArrayLike,
        *,
        temperature_degC: ArrayLike | Columns | None = None,
        gnss: GnssLog | Columns | None = None,
        lat_deg: float,
        lon_deg: float = 0.0,
        height_m: float = 0.0,
        serial: str,
        technology: str,
        start_utc: str | None = None,
    ) -> Self:
        """A run of arrays, checked as a run directory is.

        Parameters
        ----------
        time_s : array_like, shape (n,)
            Seconds from the run's start, strictly increasing.
        gyro_rad_s, accel_m_s2 : array_like, shape (n, 3)
            Angular rate and specific force in body axes (x forward, y right, z down): means over
            the interval that ends at `time_s`. At rest and level the force is (0, 0, -9.8).
        temperature_degC : array_like, shape (n,) or (n, 3), or columns, optional
            Of all gyros or of each, at `time_s`; or `time_s`, `gyro_x_degC` ... with times of their
            own (a dict or a pandas table). Without it no thermal table can be renewed.
        gnss : columns or GnssLog, optional
            `time_s`, `lat_deg`, `lon_deg`, `height_m`, `vn_m_s`, `ve_m_s`, `vd_m_s`, and the
            sigmas of formats.md.
        lat_deg, lon_deg, height_m : float
            Where the run starts; the latitude is taken to half a unit of its last digit, at least
            0.001 deg.
        serial : str
            Serial number of the unit.
        technology : {'rlg', 'fog', 'mems'}
        start_utc : str, optional
            ISO 8601, such as 2026-03-01T05:00:00Z. Default: so long ago that the run ends now.

        Returns
        -------
        Run

        Raises
        ------
        InputError
            Where shapes do not agree, a value is missing, times do not increase, or gravity, its
            sign or the Earth's rate contradict units, axes or latitude. Names row and column.

        Examples
        --------
        >>> import numpy as np, recal
        >>> t = np.arange(1, 6001) / 100.0
        >>> w = np.tile([5.05e-5, 0.0, -5.26e-5], (6000, 1))
        >>> f = np.tile([0.0, 0.0, -9.807], (6000, 1))
        >>> run = recal.Run.from_arrays(
        ...     t, w, f, temperature_degC=np.full(6000, 25.0) + t / 60, lat_deg=46.2,
        ...     serial="SN-7", technology="fog", start_utc="2026-03-01T05:00:00Z",
        ... )
        >>> run.imu.rows, round(run.imu.rate_hz)
        (6000, 100)
        """
        time = _array("time_s", time_s, (None,))
        n = time.size
        w = _array("gyro_rad_s", gyro_rad_s, (n, 3))
        f = _array("accel_m_s2", accel_m_s2, (n, 3))
        streams: dict[str, Columns] = {
            "imu": {"time_s": time, **spread(schema.RATE_COLUMNS, np.hstack([w, f]))}
        }
        if temperature_degC is not None:
            streams["temperature"] = _temperatures(time, temperature_degC)
        if gnss is not None:
            streams["gnss"] = gnss.columns() if isinstance(gnss, GnssLog) else gnss
        if start_utc is None:
            length = timedelta(seconds=float(time[-1]) if n and np.isfinite(time[-1]) else 0.0)
            start_utc = (datetime.now(UTC) - length).strftime("%Y-%m-%dT%H:%M:%SZ")
        site = {"lat_deg": lat_deg, "lon_deg": lon_deg, "height_m": height_m}
        header = {
            "schema": schema.SCHEMA,
            "run_id": f"{serial}-{start_utc}",
            "tail": "",
            "imu_serial": serial,
            "gyro_technology": technology,
            "start_utc": start_utc,
            "site": site,
        }
        return cls.of(_read_back(header, streams))

    @classmethod
    def from_frame(cls, frame: "pd.DataFrame", **given: Any) -> Self:
        """A run of a pandas table whose column names say what they hold and its unit.

        Parameters
        ----------
        frame : pandas.DataFrame
            A column of time (`time_s`, `t_ms`), three of rates (`gyro_x_deg_s`, `wx [rad/s]`),
            three of specific force (`acc_x_g`, `fx_m_s2`), and where there is one a temperature
            (`temp_degC`, or one a gyro), in body axes as of `from_arrays`.
        **given
            The other arguments of `from_arrays`: `lat_deg`, `serial`, `technology`, ...

        Returns
        -------
        Run

        Raises
        ------
        InputError
            Names the column that is missing or says no unit.

        Examples
        --------
        >>> import numpy as np, pandas as pd, recal
        >>> t = np.arange(1, 6001) * 10.0
        >>> columns = {"t_ms": t, "acc_x_g": 0 * t, "acc_y_g": 0 * t, "acc_z_g": 0 * t - 1.0}
        >>> rates = {"wx_deg_h": 10.4 + 0 * t, "wy_deg_h": 0 * t, "wz_deg_h": 0 * t - 10.9}
        >>> run = recal.Run.from_frame(
        ...     pd.DataFrame(columns | rates), lat_deg=46.2, serial="SN-7", technology="fog"
        ... )
        >>> round(run.imu.rate_hz)
        100
        """
        arrays = frame_arrays(frame)
        return cls.from_arrays(
            arrays.time_s,
            arrays.gyro_rad_s,
            arrays.accel_m_s2,
            **{"temperature_degC": arrays.temperature_degC, **given},
        )

    def to_html(self, path: AnyPath) -> Path:
        """Write what the run holds as one page that fetches nothing.

        Parameters
        ----------
        path : str or path
            The file to write; its folder must be there.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        InputError
            Where the file cannot be written.
        """
        page = render_page("run.html.j2", run=self, series=series_of(self))
        return write_text(Path(path), page)

    def plot(self) -> "Figure":
        """Rates, specific force, temperatures and fixes over time.

        Returns
        -------
        plotly.graph_objects.Figure
            A notebook shows it; `.write_html(path)` writes it.
        """
        return figure_of(list(series_of(self).values()))


def read_run(path: AnyPath) -> Run:
    """One power-on session from its directory, without its truth.

    Parameters
    ----------
    path : str or path
        A run directory (run.json and its streams).

    Returns
    -------
    Run
        Header, IMU increments [rad, m/s], temperatures [degC], aiding, phases; times in s from the
        run's start. `Run.faults` lists what was repaired or dropped.

    Raises
    ------
    InputError
        Names file, row or key, what was got and what was needed.

    Examples
    --------
    >>> import recal
    >>> recal.read_run("nowhere")
    Traceback (most recent call last):
        ...
    ins.records.InputError: nowhere: no such run directory
    """
    return Run.of(directory.read_run(Path(path)))


def _array(name: str, values: ArrayLike, shape: tuple[int | None, ...]) -> NDArray:
    """Values as float64 of a shape, None for any length."""
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name}: not an array of numbers") from None
    sizes = zip(found.shape, shape)
    if found.ndim != len(shape) or any(want not in (None, got) for got, want in sizes):
        wanted = ", ".join("n" if size is None else str(size) for size in shape)
        raise InputError(f"{name}: shape {found.shape}, needed ({wanted})")
    return found


def _temperatures(time_s: NDArray, given: ArrayLike | Columns) -> Columns:
    """The columns of a temperature stream; readings at the rate of the imu as means of a second."""
    if isinstance(given, Mapping) or hasattr(given, "columns"):
        return cast(Columns, given)
    values = np.asarray(given, dtype=float)
    if values.ndim == 1:
        values = np.repeat(values[:, None], 3, axis=1)
    log = second_means(time_s, _array("temperature_degC", values, (time_s.size, 3)))
    if log is None:
        raise InputError("temperature_degC: no row has a value")
    return {"time_s": log.time_s, **spread(GYRO_DEGC, log.gyro_degC)}


def _read_back(header: Mapping[str, Any], streams: Mapping[str, Columns]) -> records.Run:
    """The run as its directory would hold it, with all checks of one."""
    with tempfile.TemporaryDirectory(prefix="recal-arrays-") as made:
        folder = Path(made)
        (folder / "run.json").write_text(to_json(header), encoding="utf-8")
        for name, columns in streams.items():
            told = {key: np.asarray(columns[key], dtype=float) for key in columns}
            if len({values.size for values in told.values()}) > 1:
                raise InputError(f"{name}: columns differ in length")
            write_columns(folder / f"{name}.parquet", told)
        try:
            return directory.read_run(folder, held_rows=ALL_ROWS)
        except InputError as error:
            line = str(error).replace(f"{folder}: ", "").replace(".parquet", "")
            raise InputError(line.replace("run.json: ", "")) from None
