"""A column map to begin with, of a table that nobody described: columns by their names and values,
units by gravity and the Earth's rate.

What the log cannot show stays PLACEHOLDER, which no reader of a map takes.
"""

import csv
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.earth import EARTH_RATE_RAD_S
from ins.records import AXES, InputError
from ins.robust import robust_scatter
from ins.units import DEG, DEG_PER_HOUR, STANDARD_GRAVITY
from trajectories.readers.columns.layouts import content_format, flat_names, read_columns
from trajectories.readers.columns.mat_columns import leaves
from trajectories.readers.columns.named_columns import NamedColumn, named, says_other, triad
from trajectories.readers.rows.column_map import (
    ACCEL_INCREMENTS,
    ACCEL_RATES,
    GYRO_INCREMENTS,
    GYRO_RATES,
    PLACEHOLDER,
    TIME_UNITS,
    LayoutKeys,
)
from trajectories.runs.checks import MAX_RATE_HZ, MIN_RATE_HZ
from trajectories.runs.text_rows import text_parts

OF_GRAVITY = 0.05  # how far a mean force may be off it: MEMS have scales within 3 %
# of three columns that are named as accelerometers, in a unit of rates: a public MPU-6050 reads
# 0.85 g; the units of rates are a factor of 3.3 and more apart
OF_GRAVITY_BY_NAME = 0.2
# of a mean rate at rest: at 5, OF_EARTH_RATE is one sigma; below, the mean is too uncertain
EARTH_RATE_SIGMAS = 5.0
OF_EARTH_RATE = 0.2  # likewise of the Earth's rate, where the name says the unit: 3 deg/h of bias
# where nothing does: biases of MEMS fall there by chance (of two public ones 7 and 9 % off)
OF_EARTH_RATE_ALONE = 0.05
BLOCK_S = 2.0  # of which the calmest are taken for rest
CALM_SHARE = 0.2
TURNS_AGREE = 0.7  # least correlation of gravity's turns with the rates; noise alone has 0.1
LEVEL = 0.9  # of gravity along one axis: a unit within 25 deg of it
UNIX_S = (1.6e9, 2.5e9)  # September 2020 on; seconds of GPS time get there in 2030
COLDEST, HOTTEST = -76.0, 400.0  # -60 degC in degF, 127 degC in K (docs/log_formats.md)
UNIT_SIZE = 1.0 + 1e-6  # parts of a quaternion or rotation matrix are at most 1, but for rounding
SLOW = 0.02  # of all its change in one row; white noise has 0.2 (tests/trajectories)
OFTEN_HZ = (10.0, 2000.0)  # rates of loggers: what a run may have (formats.md)
# units of forces that loggers use, the commonest first: those of columns whose names say nothing
COMMONEST = ("m/s2", "g", "mg", "m/s", "cm/s2", "mm/s2", "ft/s2")
SIGHTED_BYTES = 1 << 16  # of the text's beginning
SIGHTED_ROWS = 20  # that have to agree
FEWEST_NUMBERS = 6  # of a row: 3 rates and 3 forces
SIGNS = (
    (";", ","),
    ("\t", ","),
    (" ", ","),
    (",", "."),
    (";", "."),
    ("\t", "."),
    ("|", "."),
    (" ", "."),
)
NUMBER = {
    ".": re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[nN]a[nN]|"),
    ",": re.compile(r"[-+]?(\d+,?\d*|,\d+)([eE][-+]?\d+)?|[nN]a[nN]|"),
}
COMMENT = re.compile(r"\s*(#|%|//)")
UNIT_LINE = re.compile(r"[\[(]?[a-zA-Z\u00b0\u00b5/^0-9\u00b2*._ -]{0,12}[\])]?")


@dataclass(kw_only=True)
class StarterMap:
    """The text of a map, what was guessed with the reason, and the keys that are to be filled."""

    guesses: list[tuple[str, str]] = field(default_factory=list)  # key, what and why
    missing: list[str] = field(default_factory=list)
    text: str = ""


@dataclass(frozen=True)
class _Unit:
    """A unit, its factor to SI and why; increments: whether a value covers an interval."""

    unit: str
    factor: float
    why: str
    increments: bool = False


def starter_map(path: Path) -> StarterMap | None:
    """The map to begin with; None where the file is no table of six columns of numbers. InputError
    where it is one, but not of gyros and accelerometers.
    """
    kind = content_format(path)
    if kind == "csv":
        found = text_layout(path)
        if found is None:
            return None
        layout, names, units = found.layout, found.names, found.units
        held = found.numbers
    elif kind == "parquet":
        layout, held = LayoutKeys(), tuple(flat_names(path))
        names, units = held, ("",) * len(held)
    else:
        return _of_matrices(path)
    try:
        columns, _ = read_columns(path, layout, held)
    except InputError:
        return None
    said = [named(f"{n} [{u.strip('[]()')}]" if u else n) for n, u in zip(names, units)]
    known = [replace(s, name=n) for n, s in zip(names, said) if n in columns]
    return _Guess(path.name, layout, known, columns).map()


def _of_matrices(path: Path) -> StarterMap | None:
    """The map of a MATLAB file: each column of its longest matrices, x, y and z where there are
    three; None where these are no gyros and accelerometers.
    """
    values, _ = leaves(path)
    rows = max((len(v) for v in values.values()), default=0)
    columns: dict[str, NDArray] = {}
    known = []
    for name, matrix in values.items():
        if len(matrix) != rows:
            continue
        width = matrix.shape[1]
        for k in range(width):
            column = name if width == 1 else f"{name}[{k}]"
            word = f"{name}_{AXES[k]}" if width == len(AXES) else name
            known.append(replace(named(word.rpartition(".")[2]), name=column))
            columns[column] = matrix[:, k]
    if not (triad(known, "accel") and triad(known, "gyro")):
        return None
    return _Guess(path.name, LayoutKeys(), known, columns).map()


class _Guess:
    """The map as it grows, table by table."""

    def __init__(
        self,
        label: str,
        layout: LayoutKeys,
        known: Sequence[NamedColumn],
        columns: Mapping[str, NDArray],
    ) -> None:
        self._label = label
        self._known, self._columns = known, columns
        self._found, self._lines = StarterMap(), _layout_lines(layout)
        self._rate_hz = np.nan
        self._taken: set[str] = set()

    def map(self) -> StarterMap:
        self._time()
        accel, gyro = self._triads()
        if not accel or not gyro:
            what = "read gravity at rest in any unit" if not accel else "are named as gyros"
            raise InputError(
                f"{self._label}: a table of {len(self._columns)} columns of numbers, no three of"
                f" which {what}; needed raw gyros and raw accelerometers, gravity included, in one"
                " file; a map may name them (docs/log_formats.md)"
            )
        whole = self._whole([*accel, *gyro])
        f, w = whole[:, :3], whole[:, 3:]
        calm = _calm(f, self._rate_hz)
        of_accel = self._accel_unit(accel, f[calm])
        of_gyro = self._gyro_unit(gyro, w, f, calm, of_accel)
        self._table("gyro", {"columns": gyro, "unit": of_gyro.unit}, of_gyro.why)
        self._table("accel", {"columns": accel, "unit": of_accel.unit}, of_accel.why)
        self._axes(np.mean(f[calm], axis=0))
        self._temperature()
        self._gnss_and_run()
        self._found.text = "\n".join(self._lines) + "\n"
        return self._found

    def _whole(self, names: Sequence[str]) -> NDArray:
        """The rows (n, k) of columns in which none is missing."""
        rows = np.stack([self._columns[name] for name in names], axis=1)
        return rows[np.isfinite(rows).all(axis=1)]

    def _table(self, key: str, values: Mapping[str, str | float | list[str]], why: str) -> None:
        self._lines += ["", f"# {why}", f"[{key}]"]
        self._lines += [f"{name} = {_toml(value)}" for name, value in values.items()]
        shown = values.get("columns", values.get("column", ""))
        names = ", ".join(shown) if isinstance(shown, list) else str(shown)
        self._taken |= set(names.split(", "))
        self._found.guesses.append((key, f"{names} [{values.get('unit', '')}]: {why}"))
        self._found.missing += [f"{key}.{k}" for k, v in values.items() if v == PLACEHOLDER]

    def _time(self) -> None:
        """A column that always rises; its unit by the rate that it gives."""
        named_so = [c for c in self._known if c.quantity == "time"]
        rising = [c for c in [*named_so, *self._known] if _rises(self._columns[c.name])]
        if not rising:
            self._lines += ["", "# No column rises all the time: the rate of the rows [Hz]."]
            self._lines.append(f"rate_hz = {_toml(PLACEHOLDER)}")
            self._found.missing.append("rate_hz")
            return
        column = rising[0]
        values = self._columns[column.name]
        step = float(np.median(np.diff(values[np.isfinite(values)])))
        fits = [u for u, s in TIME_UNITS.items() if OFTEN_HZ[0] <= 1 / (step * s) <= OFTEN_HZ[1]]
        fits += [u for u, s in TIME_UNITS.items() if MIN_RATE_HZ <= 1 / (step * s) <= MAX_RATE_HZ]
        unit = column.unit if column.unit in fits else next(iter(fits), PLACEHOLDER)
        why = f"always rises, by {step:.6g}"
        if unit != PLACEHOLDER:
            self._rate_hz = 1 / (step * TIME_UNITS[unit])
            why += f": {self._rate_hz:.5g} Hz in {unit}"
        keys = {"column": column.name, "unit": unit}
        if unit != PLACEHOLDER and UNIX_S[0] < values[0] * TIME_UNITS[unit] < UNIX_S[1]:
            keys["epoch"] = "unix"
            why += "; counts from 1970"
        self._table("time", keys, why)

    def _triads(self) -> tuple[list[str], list[str]]:
        """Columns of the accelerometers and of the gyros, by their names, else by gravity."""
        accel = [c.name for c in triad(self._known, "accel")]
        gyro = [c.name for c in triad(self._known, "gyro")]
        if accel:
            return accel, gyro
        accel = self._by_gravity(gyro)
        return accel, gyro or self._beside(accel)

    def _by_gravity(self, gyro: Sequence[str]) -> list[str]:
        """Three columns in turn that read gravity at rest, in the commonest unit."""
        found = []
        for k, three in enumerate(self._threes(gyro)):
            units = [one.unit for one in self._gravity(three)]
            # of those that share the axis of gravity the one that begins a three
            found += [(COMMONEST.index(u), k % 3, three) for u in units if u in COMMONEST]
        return min(found)[2] if found else []

    def _beside(self, accel: Sequence[str]) -> list[str]:
        """The three columns before those of the accelerometers, else the three after them."""
        names = [c.name for c in self._known]
        if not accel:
            return []
        at = names.index(accel[0])
        beside = (names[max(at - 3, 0) : at], names[at + 3 : at + 6])
        threes = self._threes(accel)
        return next((three for three in beside if three in threes), [])

    def _threes(self, taken: Sequence[str]) -> list[list[str]]:
        """Three columns side by side that may be one sensor's."""
        names = [c.name for c in self._known]
        free = set(self._free()) - set(taken)
        threes = [names[k : k + 3] for k in range(len(names) - 2)]
        return [three for three in threes if free.issuperset(three)]

    def _free(self) -> list[str]:
        """Columns that go up and down and may be a sensor's: those whose names say something else
        are none, but for a t with its axis, which is a force as often as a temperature.
        """
        return [
            c.name
            for c in self._known
            if (c.quantity in ("", "accel", "gyro") or _of_one_letter(c))
            and c.name not in self._taken
            and not says_other(c.name)
            and _goes_up_and_down(self._columns[c.name])
        ]

    def _gravity(self, names: Sequence[str], within: float = OF_GRAVITY) -> list[_Unit]:
        """Units in which three columns read gravity, the nearest first: rates where as near."""
        f = self._whole(names)
        if not len(f):
            return []
        size = float(np.median(np.linalg.norm(f[_calm(f, self._rate_hz)], axis=1)))
        found = []
        for units, scale in ((ACCEL_RATES, 1.0), (ACCEL_INCREMENTS, self._rate_hz)):
            for unit, factor in units.items():
                off = abs(size * factor * scale / STANDARD_GRAVITY - 1.0)
                if off < within:
                    shown = f"at rest |f| is {size * factor * scale:.3f} m/s2 in {unit}"
                    shown += f", {100.0 * off:.0f} % off gravity" if off > OF_GRAVITY else ""
                    found.append(
                        (off, _Unit(unit, factor * scale, shown, units is not ACCEL_RATES))
                    )
        # to 1 %: a row of 10 ms makes 1 cm/s of 1 m/s2
        return [unit for _, unit in sorted(found, key=lambda pair: round(pair[0], 2))]

    def _accel_unit(self, names: Sequence[str], calm: NDArray) -> _Unit:
        said = self._said_unit(names)
        fits = self._gravity(names)
        by_name = [one for one in fits if one.unit == said]
        if by_name or fits:
            best = (by_name or fits)[0]
            why = best.why if by_name or not said else f"{best.why}, although its name says {said}"
            return _Unit(best.unit, best.factor, why, best.increments)
        near = [one for one in self._gravity(names, OF_GRAVITY_BY_NAME) if not one.increments]
        if near and said in ("", near[0].unit):
            return near[0]
        size = float(np.median(np.linalg.norm(calm, axis=1)))
        why = f"at rest |f| is {size:.4g}: no unit makes that gravity; is it taken off?"
        return _Unit(PLACEHOLDER, 1.0, why)

    def _at_rest(self, calm: NDArray) -> tuple[float, float]:
        """Size and sigma of the median of the blocks' means: a turn at a steady rate is calm too,
        and shorter.
        """
        rows = _block_rows(self._rate_hz)
        blocks = max(len(calm) // rows, 1)
        means = np.mean(calm[: blocks * rows].reshape(blocks, -1, calm.shape[1]), axis=1)
        of_blocks = robust_scatter(means) / np.sqrt(blocks)
        of_rows = robust_scatter(calm) / np.sqrt(len(calm))
        sigma = np.sqrt(0.5 * np.pi) * np.linalg.norm(np.maximum(of_blocks, of_rows))
        return float(np.linalg.norm(np.median(means, axis=0))), float(sigma)

    def _said_unit(self, names: Sequence[str]) -> str:
        return next(c.unit for c in self._known if c.name == names[0])

    def _gyro_unit(
        self, names: Sequence[str], w: NDArray, f: NDArray, calm: NDArray, accel: _Unit
    ) -> _Unit:
        """By the turns of gravity; else by the Earth's rate at rest; else by the name alone."""
        said = self._said_unit(names)
        units = GYRO_INCREMENTS if accel.increments else GYRO_RATES
        scale = self._rate_hz if accel.increments else 1.0
        slope = _turns(w * scale, f, self._rate_hz)
        fits = [u for u, factor in units.items() if abs(slope / factor - 1.0) < 0.3]
        if fits:
            why = f"gravity turns as these rates say in {fits[0]}"
            return _Unit(fits[0], units[fits[0]], why)
        size, sigma = self._at_rest(w[calm])
        known = size > EARTH_RATE_SIGMAS * sigma
        for unit, factor in units.items() if known else ():
            rate_deg_h = size * factor * scale / DEG_PER_HOUR
            within = OF_EARTH_RATE if said == unit else OF_EARTH_RATE_ALONE
            if abs(rate_deg_h * DEG_PER_HOUR / EARTH_RATE_RAD_S - 1.0) < within:
                why = f"at rest |w| is {rate_deg_h:.2f} deg/h in {unit}, the Earth's rate 15.04"
                why += f", although its name says {said}" if said not in ("", unit) else ""
                return _Unit(unit, factor, why)
        if said in units:
            shown = size * units[said] * scale / DEG
            why = f"by its name alone: at rest |w| is {shown:.3g} deg/s, no Earth's rate"
            return _Unit(said, units[said], why)
        why = f"at rest |w| is {size:.4g}, and neither the name nor a turn says in what"
        return _Unit(PLACEHOLDER, 1.0, why)

    def _axes(self, mean: NDArray) -> None:
        """The raw axis that points down, by gravity; the other two in turn."""
        share = mean / np.linalg.norm(mean)
        k = int(np.argmax(np.abs(share)))
        if abs(share[k]) < LEVEL:
            why = "the unit lies too steep for gravity to tell its axes: taken as x forward, z down"
            axes = dict(zip(AXES, AXES))
        else:
            down_sign = "-" if share[k] > 0 else ""
            x, y = AXES[(k + 1) % 3], AXES[(k + 2) % 3]
            axes = {"x": x, "y": f"{down_sign}{y}", "z": f"{down_sign}{AXES[k]}"}
            way = "up" if down_sign else "down"
            why = (
                f"{AXES[k]} of the log points {way}; which of the others is forward nobody can see"
            )
        self._lines += ["", f"# Body x forward, y right, z down; {why}.", "[axes]"]
        self._lines += [f"{name} = {_toml(value)}" for name, value in axes.items()]
        shown = ", ".join(f"{name} = {value}" for name, value in axes.items())
        self._found.guesses.append(("axes", f"{shown}: {why}"))

    def _temperature(self) -> None:
        free = [c for c in self._known if c.name not in self._taken]
        warm = triad(free, "temperature")
        warm = warm or [c for c in free if c.quantity == "temperature"][:1]
        if not warm:
            self._temperature_by_values()
            return
        middle = float(np.nanmedian(self._columns[warm[0].name]))
        unit, why = warm[0].unit, f"reads {middle:.4g}"
        if not unit:
            unit = "K" if middle > 200.0 else "degC"
            why += f", which a unit has in {unit}"
        self._table("temperature", {"columns": [c.name for c in warm], "unit": unit}, why)

    def _temperature_by_values(self) -> None:
        """A column without a known name that reads and changes as a temperature does."""
        bare = [c.name for c in self._known if not c.quantity and c.name not in self._taken]
        bare = [name for name in bare if not says_other(name)]
        slow = [name for name in bare if _like_temperature(self._columns[name])]
        if not slow:
            self._lines += ["", "# No temperature: this log cannot renew a thermal table."]
            return
        low, high = np.nanquantile(self._columns[slow[0]], (0.0, 1.0))
        why = (
            f"perhaps a temperature, {low:.4g} to {high:.4g}: degC, degF, K, or delete these lines"
        )
        self._table("temperature", {"column": slow[0], "unit": PLACEHOLDER}, why)

    def _gnss_and_run(self) -> None:
        """Fixes with velocities; the site is their first, else it is to be given."""
        place = [
            next((c for c in self._known if c.quantity == q), None)
            for q in ("lat", "lon", "height")
        ]
        site: dict[str, str | float] = {"lat_deg": PLACEHOLDER, "lon_deg": 0.0, "height_m": 0.0}
        positions = [c for c in place if c and np.isfinite(self._columns[c.name]).any()]
        if len(positions) == 3:
            largest = float(np.nanmax(np.abs(self._columns[positions[0].name])))
            unit = "1e-7 deg" if largest > 360 else positions[0].unit or "deg"
            self._lines += [
                "",
                "# Fixes: latitude, longitude, height above the ellipsoid.",
                "[gnss]",
            ]
            self._lines += ["[gnss.position]", f"columns = {_toml([c.name for c in positions])}"]
            self._lines += [
                f"unit = {_toml(unit)}",
                f"height_unit = {_toml(positions[2].unit or 'm')}",
            ]
            for frame in ("ned", "enu"):
                three = triad(self._known, "velocity", frame)
                if three:
                    self._lines += [
                        "[gnss.velocity]",
                        f"columns = {_toml([c.name for c in three])}",
                    ]
                    self._lines += [
                        f"frame = {_toml(frame)}",
                        f"unit = {_toml(three[0].unit or 'm/s')}",
                    ]
                    break
            self._found.guesses.append(("gnss", ", ".join(c.name for c in positions)))
            site = {}
        self._lines += ["", "# What no column shows.", "[run]"]
        for key, words in (
            ("imu_serial", "serial number of the unit"),
            ("gyro_technology", "rlg, fog or mems"),
            ("start_utc", "such as 2026-03-01T05:00:00Z"),
        ):
            if key == "start_utc" and any(line == 'epoch = "unix"' for line in self._lines):
                continue
            self._lines.append(f"{key} = {_toml(PLACEHOLDER)} # {words}")
            self._found.missing.append(f"run.{key}")
        if site:
            values = ", ".join(f"{key} = {_toml(value)}" for key, value in site.items())
            self._lines.append(f"site = {{ {values} }} # where the run starts")
            self._found.missing.append("run.site.lat_deg")


def _goes_up_and_down(values: NDArray) -> bool:
    """No constant and no counter."""
    steps = np.diff(values[np.isfinite(values)])
    return bool((steps > 0.0).any() and (steps < 0.0).any())


def _of_one_letter(column: NamedColumn) -> bool:
    """Whether a name such as tx says a temperature by its letter alone."""
    return column.quantity == "temperature" and column.axis != "" and len(column.name) == 2


def _toml(value: object) -> str:
    """A text, a number or a list of texts."""
    return json.dumps(value, ensure_ascii=False)


def _layout_lines(layout: LayoutKeys) -> list[str]:
    given = layout.model_dump(exclude_unset=True)
    head = '# A column map that recal look began: see that it is right, and fill in each "?".'
    return [head, *(f"{key} = {_toml(value)}" for key, value in given.items())]


def _rises(values: NDArray) -> bool:
    """Whether nearly all steps go up."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(steps.size and np.mean(steps > 0) > 0.99)


def _calm(f: NDArray, rate_hz: float) -> NDArray:
    """Rows (n,) of the calmest blocks, by the scatter of the forces."""
    rows = _block_rows(rate_hz)
    blocks = len(f) // rows
    if blocks < 2:
        return np.ones(len(f), dtype=bool)
    shaped = f[: blocks * rows].reshape(blocks, rows, 3)
    scatter = np.std(shaped, axis=1).max(axis=1)
    limit = np.quantile(scatter, CALM_SHARE)
    kept = np.zeros(len(f), dtype=bool)
    kept[: blocks * rows] = np.repeat(scatter <= limit, rows)
    return kept


def _block_rows(rate_hz: float) -> int:
    return max(int(BLOCK_S * rate_hz), 10) if np.isfinite(rate_hz) else 100


def _like_temperature(values: NDArray) -> bool:
    """Within what thermometers read in degC, degF or K, no part of a quaternion, and slow against
    its whole change.
    """
    finite = values[np.isfinite(values)]
    if finite.size < 2 or finite.min() < COLDEST or finite.max() > HOTTEST:
        return False
    if np.abs(finite).max() <= UNIT_SIZE:
        return False
    change = float(np.ptp(finite))
    return change > 0.0 and float(np.std(np.diff(finite))) < SLOW * change


def _turns(w: NDArray, f: NDArray, rate_hz: float) -> float:
    """The factor from raw rates to rad/s by which they turn gravity, df/dt = -w x f; NaN where the
    two do not agree.
    """
    rows = max(int(0.2 * rate_hz), 1) if np.isfinite(rate_hz) else 0
    blocks = len(f) // rows if rows else 0
    if blocks < 20:
        return float("nan")
    means = [v[: blocks * rows].reshape(blocks, rows, 3).mean(axis=1) for v in (w, f)]
    turned = -np.cross(0.5 * (means[0][1:] + means[0][:-1]), 0.5 * (means[1][1:] + means[1][:-1]))
    moved = np.diff(means[1], axis=0) * rate_hz / rows
    good = np.isfinite(turned).all(axis=1) & np.isfinite(moved).all(axis=1)
    a, b = turned[good].ravel(), moved[good].ravel()
    power = float(a @ a)
    if not power or a @ b < TURNS_AGREE * np.sqrt(power * float(b @ b)):
        return float("nan")
    return float(a @ b) / power


@dataclass(frozen=True)
class TextLayout:
    """The layout as a map says it, the names of the columns in turn, the unit of each where a line
    below the names gives them, and which columns hold numbers.
    """

    layout: LayoutKeys
    names: tuple[str, ...]
    units: tuple[str, ...]
    numbers: tuple[str, ...]


def text_layout(path: Path) -> TextLayout | None:
    """How the rows of a text lie; None where it holds no rows of six numbers or more."""
    try:
        head = next(iter(text_parts(path, [], block_bytes=SIGHTED_BYTES)), b"")[:SIGHTED_BYTES]
    except InputError:
        return None
    if b"\x00" in head:
        return None
    text = head.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    lines = lines[:-1] if len(lines) > 1 else lines  # the last may be cut
    best: tuple[int, int, str, str] | None = None
    for sign, decimal in SIGNS:
        found = _first_row(lines, sign, decimal)
        if found and (best is None or found[1] > best[1]):
            best = *found, sign, decimal
    return None if best is None else _layout(lines, *best)


def _first_row(lines: Sequence[str], sign: str, decimal: str) -> tuple[int, int] | None:
    """The first line of rows that agree in size, and how many numbers each has; None without."""
    run, size, numbers = 0, 0, 0
    for k, line in enumerate(lines):
        row = _fields(line, sign)
        count = sum(bool(NUMBER[decimal].fullmatch(field)) and field != "" for field in row)
        empty = row.count("")
        is_row = count >= FEWEST_NUMBERS and count + empty >= len(row) / 2
        if is_row and run and len(row) == size:
            run, numbers = run + 1, min(numbers, count)
        else:
            run, size, numbers = int(is_row), len(row), count
        if run == min(SIGHTED_ROWS, max(len(lines) - k, 2)):
            return k - run + 1, numbers
    return None


def _fields(line: str, sign: str) -> list[str]:
    if sign == " ":
        return line.split()
    return [field.strip() for field in next(csv.reader([line], delimiter=sign), [])]


def _layout(lines: Sequence[str], first: int, numbers: int, sign: str, decimal: str) -> TextLayout:
    row = _fields(lines[first], sign)
    above = [k for k in range(first) if lines[k].strip()]
    heads = [(k, _fields(re.sub(COMMENT, "", lines[k], count=1), sign)) for k in above[-2:]]
    heads = [(k, _of_length(fields, row)) for k, fields in heads]
    heads = [(k, fields) for k, fields in heads if len(fields) == len(row)]
    units = ("",) * len(row)
    if len(heads) == 2 and _is_group_line(heads[0][1]):
        heads = [(heads[1][0], _joined(heads[0][1], heads[1][1]))]
    if len(heads) == 2 and all(UNIT_LINE.fullmatch(unit) for unit in heads[1][1]):
        units = tuple(heads.pop()[1])
    keys: dict[str, str | int | list[str]] = (
        {"format": "csv", "delimiter": sign} if sign != " " else {"format": "text"}
    )
    if decimal != ".":
        keys["decimal"] = decimal
    keys["header_lines"] = first
    named = heads[-1][1] if heads and len(set(heads[-1][1])) == len(row) else []
    names = named or [f"column_{k + 1}" for k in range(len(row))]
    if named and _fields(lines[heads[-1][0]], sign) == named:
        keys["names_line"] = heads[-1][0] + 1
    else:
        keys["columns"] = names
    held = [n for n, field in zip(names, row) if NUMBER[decimal].fullmatch(field)]
    return TextLayout(LayoutKeys.model_validate(keys), tuple(names), units, tuple(held))


def _of_length(fields: list[str], row: Sequence[str]) -> list[str]:
    """The fields of a head as many as those of a row, where the one or the other ends with signs
    that part nothing.
    """
    spare = [f"column_{k + 1}" for k in range(len(fields), len(row))]
    if any(fields[len(row) :]) or any(row[len(fields) :]):
        return fields
    return [*fields[: len(row)], *spare]


def _is_group_line(fields: Sequence[str]) -> bool:
    """Whether a line names groups of columns: each name stands over the first of its columns."""
    return fields.count("") > 0 and fields[0] != "" and sum(f != "" for f in fields) > 1


def _joined(groups: Sequence[str], parts: Sequence[str]) -> list[str]:
    """Names of a group and a part: "IMU Gyroscope" over "X" is "IMU Gyroscope X"."""
    group, names = "", []
    for above, below in zip(groups, parts):
        group = above or group
        names.append(f"{group} {below}".strip())
    return names
