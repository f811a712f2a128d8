"""A column map to begin with, of a table that nobody described: columns by their names and values,
units by gravity and the Earth's rate.

What the log cannot show stays PLACEHOLDER, which no reader of a map takes.
"""

import csv
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ins.earth import EARTH_RATE_RAD_S
from ins.records import AXES, InputError
from ins.units import DEG, DEG_PER_HOUR, STANDARD_GRAVITY
from trajectories.readers.columns.layouts import content_format, read_columns
from trajectories.readers.columns.named_columns import NamedColumn, named, triad
from trajectories.readers.columns.parquet_columns import flat_names
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
OF_EARTH_RATE = 0.2  # likewise of the Earth's rate: 3 deg/h of bias
BLOCK_S = 2.0  # of which the calmest are taken for rest
CALM_SHARE = 0.2
TURNS_AGREE = 0.7  # least correlation of gravity's turns with the rates; noise alone has 0.1
LEVEL = 0.9  # of gravity along one axis: a unit within 25 deg of it
UNIX_S = (1.6e9, 2.5e9)  # September 2020 on; seconds of GPS time get there in 2030
COLDEST, HOTTEST = -76.0, 400.0  # -60 degC in degF, 127 degC in K (docs/log_formats.md)
SLOW = 0.02  # of all its change in one row; white noise has 0.2 (tests/trajectories)
OFTEN_HZ = (10.0, 2000.0)  # rates of loggers: what a run may have (formats.md)
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
    """The map to begin with; None where the file is no table of six columns of numbers."""
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
        return None
    try:
        columns, _ = read_columns(path, layout, held)
    except InputError:
        return None
    said = [named(f"{n} [{u.strip('[]()')}]" if u else n) for n, u in zip(names, units)]
    known = [
        NamedColumn(n, s.quantity, s.axis, s.unit, s.stem)
        for n, s in zip(names, said)
        if n in columns
    ]
    return _Guess(layout, known, columns).map()


class _Guess:
    """The map as it grows, table by table."""

    def __init__(
        self, layout: LayoutKeys, known: Sequence[NamedColumn], columns: Mapping[str, NDArray]
    ) -> None:
        self._known, self._columns = known, columns
        self._found, self._lines = StarterMap(), _layout_lines(layout)
        self._rate_hz = np.nan
        self._taken: set[str] = set()

    def map(self) -> StarterMap | None:
        self._time()
        accel, gyro = self._triads()
        if not accel or not gyro:
            return None
        f = np.stack([self._columns[name] for name in accel], axis=1)
        w = np.stack([self._columns[name] for name in gyro], axis=1)
        calm = _calm(f, self._rate_hz)
        of_accel = self._accel_unit(accel, f[calm])
        of_gyro = self._gyro_unit(gyro, w, f, calm, of_accel)
        self._table("gyro", {"columns": gyro, "unit": of_gyro.unit}, of_gyro.why)
        self._table("accel", {"columns": accel, "unit": of_accel.unit}, of_accel.why)
        self._axes(np.nanmean(f[calm], axis=0))
        self._temperature()
        self._gnss_and_run()
        self._found.text = "\n".join(self._lines) + "\n"
        return self._found

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
        accel, gyro = triad(self._known, "accel"), triad(self._known, "gyro")
        if accel and gyro:
            return [c.name for c in accel], [c.name for c in gyro]
        bare = [c for c in self._known if not c.quantity]
        threes = [[c.name for c in bare[k : k + 3]] for k in range(len(bare) - 2)]
        heavy = [t for t in threes if self._gravity(t)]
        if not heavy:
            return [], []
        best = heavy[0]
        at = [c.name for c in bare].index(best[0])
        beside = [[c.name for c in bare[k : k + 3]] for k in (at - 3, at + 3) if k >= 0]
        beside = [t for t in beside if len(t) == 3]
        return best, beside[0] if beside else []

    def _gravity(self, names: Sequence[str]) -> list[_Unit]:
        """Units in which three columns read gravity, the nearest first."""
        f = np.stack([self._columns[name] for name in names], axis=1)
        size = float(np.nanmedian(np.linalg.norm(f[_calm(f, self._rate_hz)], axis=1)))
        found = []
        for units, scale in ((ACCEL_RATES, 1.0), (ACCEL_INCREMENTS, self._rate_hz)):
            for unit, factor in units.items():
                off = abs(size * factor * scale / STANDARD_GRAVITY - 1.0)
                if off < OF_GRAVITY:
                    shown = f"at rest |f| is {size * factor * scale:.3f} m/s2 in {unit}"
                    found.append((off, _Unit(unit, factor * scale, shown, scale != 1.0)))
        return [unit for _, unit in sorted(found, key=lambda pair: pair[0])]

    def _accel_unit(self, names: Sequence[str], calm: NDArray) -> _Unit:
        said = self._said_unit(names)
        fits = self._gravity(names)
        by_name = [one for one in fits if one.unit == said]
        if by_name or fits:
            best = (by_name or fits)[0]
            why = best.why if by_name or not said else f"{best.why}, although its name says {said}"
            return _Unit(best.unit, best.factor, why, best.increments)
        size = float(np.nanmedian(np.linalg.norm(calm, axis=1)))
        return _Unit(PLACEHOLDER, 1.0, f"at rest |f| is {size:.4g}: no unit makes that gravity")

    def _at_rest(self, calm: NDArray) -> NDArray:
        """Median of the blocks' means: a turn at a steady rate is calm too, and shorter."""
        rows = _block_rows(self._rate_hz)
        blocks = max(len(calm) // rows, 1)
        means = np.nanmean(calm[: blocks * rows].reshape(blocks, -1, calm.shape[1]), axis=1)
        return np.asarray(np.nanmedian(means, axis=0))

    def _said_unit(self, names: Sequence[str]) -> str:
        return next(c.unit for c in self._known if c.name == names[0])

    def _gyro_unit(
        self, names: Sequence[str], w: NDArray, f: NDArray, calm: NDArray, accel: _Unit
    ) -> _Unit:
        """By the Earth's rate at rest; else by the turns of gravity; else by the name alone."""
        said = self._said_unit(names)
        units = GYRO_INCREMENTS if accel.increments else GYRO_RATES
        scale = self._rate_hz if accel.increments else 1.0
        size = float(np.linalg.norm(self._at_rest(w[calm])))
        for unit, factor in units.items():
            rate_deg_h = size * factor * scale / DEG_PER_HOUR
            if abs(rate_deg_h * DEG_PER_HOUR / EARTH_RATE_RAD_S - 1.0) < OF_EARTH_RATE:
                why = f"at rest |w| is {rate_deg_h:.2f} deg/h in {unit}, the Earth's rate 15.04"
                why += f", although its name says {said}" if said not in ("", unit) else ""
                return _Unit(unit, factor, why)
        slope = _turns(w * scale, f, self._rate_hz)
        fits = [u for u, factor in units.items() if abs(slope / factor - 1.0) < 0.3]
        if fits:
            why = f"gravity turns as these rates say in {fits[0]}"
            return _Unit(fits[0], units[fits[0]], why)
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
        warm = triad(self._known, "temperature")
        warm = warm or [c for c in self._known if c.quantity == "temperature"][:1]
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
        positions = [c for c in place if c is not None]
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
    scatter = np.nan_to_num(np.nanstd(shaped, axis=1), nan=np.inf).max(axis=1)
    limit = np.quantile(scatter, CALM_SHARE)
    kept = np.zeros(len(f), dtype=bool)
    kept[: blocks * rows] = np.repeat(scatter <= limit, rows)
    return kept


def _block_rows(rate_hz: float) -> int:
    return max(int(BLOCK_S * rate_hz), 10) if np.isfinite(rate_hz) else 100


def _like_temperature(values: NDArray) -> bool:
    """Within what thermometers read in degC, degF or K, and slow against its whole change."""
    finite = values[np.isfinite(values)]
    if finite.size < 2 or finite.min() < COLDEST or finite.max() > HOTTEST:
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
        is_row = count >= FEWEST_NUMBERS and count >= len(row) / 2
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
    heads = [(k, fields) for k, fields in heads if len(fields) == len(row)]
    units = ("",) * len(row)
    if len(heads) == 2 and all(UNIT_LINE.fullmatch(unit) for unit in heads[1][1]):
        units = tuple(heads.pop()[1])
    keys: dict[str, str | int | list[str]] = (
        {"format": "csv", "delimiter": sign} if sign != " " else {"format": "text"}
    )
    if decimal != ".":
        keys["decimal"] = decimal
    comment = COMMENT.match(lines[heads[-1][0]]) if heads else None
    if heads and comment is None and len(set(heads[-1][1])) == len(row):
        names = heads[-1][1]
        keys |= {"header_lines": first, "names_line": heads[-1][0] + 1}
    else:
        named = heads[-1][1] if heads and len(set(heads[-1][1])) == len(row) else []
        names = named or [f"column_{k + 1}" for k in range(len(row))]
        keys |= {"header_lines": first, "columns": names}
    held = [n for n, field in zip(names, row) if NUMBER[decimal].fullmatch(field)]
    return TextLayout(LayoutKeys.model_validate(keys), tuple(names), units, tuple(held))
