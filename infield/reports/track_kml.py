"""track.kml: the flown tracks on a globe, KML 2.2 (OGC 07-147r2) without extensions; every free
text is escaped.

A track is a LineString with the TimeSpan that it covers; start, end and stops are points with their
times. Heights are the run's own (above the ellipsoid, as formats.md has them; a globe's are above
the sea, up to 110 m off), used where the vehicle leaves the ground by FLIES_M; a vehicle that stays
on it is clamped to the ground.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from infield.replay.free_inertial import ReplayResult
from infield.reports.drawing import GREEN, GREY, NEW, OLD
from infield.session.disagreement import utc
from ins.units import DEG

MOST_POINTS = 20_000  # of all tracks together; viewers grow slow beyond
# of height along the best track: more is a flight; chosen: 3 km of the steepest runways (2 %)
# climb 60 m
FLIES_M = 100.0
COLOURS = {"previous": OLD, "active": NEW, "aided": GREEN, "gnss": GREY}
NAMES = {
    "previous": "free-inertial, previous table",
    "active": "free-inertial, active table",
    "aided": "aided by GNSS",
    "gnss": "GNSS",
}


@dataclass(frozen=True)
class Track:
    """A track by key of COLOURS: time [s], latitude, longitude [rad], height [m], each (k,)."""

    key: str
    time_s: NDArray
    lat_rad: NDArray
    lon_rad: NDArray
    height_m: NDArray


def tracks_of(result: ReplayResult) -> tuple[Track, ...]:
    """The tracks that there are, GNSS first, so that the others are drawn over it."""
    solutions: list[tuple[str, Any]] = [
        ("gnss", result.run.gnss),
        *((t.choice.role, t.history) for t in result.tables),
    ]
    solutions += [("aided", result.aided.history)] if result.aided is not None else []
    found = [_finite(key, solution) for key, solution in solutions if solution is not None]
    return tuple(t for t in found if t.time_s.size > 1)


def _finite(key: str, solution: Any) -> Track:
    """The rows that have a place; the schema takes "nan" for a coordinate, viewers do not."""
    seen = (
        np.isfinite(solution.lat_rad)
        & np.isfinite(solution.lon_rad)
        & np.isfinite(solution.height_m)
    )
    return Track(
        key,
        *(getattr(solution, name)[seen] for name in ("time_s", "lat_rad", "lon_rad", "height_m")),
    )


def track_kml(result: ReplayResult) -> str:
    """The document; with no track at all, a document that says so."""
    header, tracks = result.run.header, tracks_of(result)
    best = next((t for key in ("aided", "gnss", "active") for t in tracks if t.key == key), None)
    mode = "clampToGround" if best is None or np.ptp(best.height_m) < FLIES_M else "absolute"
    most = MOST_POINTS // max(len(tracks), 1)
    about = (
        f"unit {header.imu_serial} ({header.gyro_technology}), started {header.start_utc}, replay:"
        f" {result.verdict}"
    )
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<kml xmlns="http://www.opengis.net/kml/2.2">',
        "<Document>",
        f"<name>{_text(header.run_id)}</name>",
        f"<description>{_text(about)}</description>",
        *(_style(key) for key in COLOURS),
        *(_line(t, mode, most, header.start_utc) for t in tracks),
    ]
    if best is not None:
        lines += _points(result, best, mode)
    return "\n".join([*lines, "</Document>", "</kml>", ""])


def _style(key: str) -> str:
    """A colour as KML writes it: alpha, blue, green, red."""
    rgb = COLOURS[key].lower()[1:]
    line = f"<LineStyle><color>ff{rgb[4:]}{rgb[2:4]}{rgb[:2]}</color><width>3</width></LineStyle>"
    return f'<Style id="{key}">{line}</Style>'


def _line(track: Track, mode: str, most: int, start_utc: str) -> str:
    rows = np.unique(
        np.linspace(0, track.time_s.size - 1, min(track.time_s.size, most)).round().astype(int)
    )
    where = " ".join(
        f"{lon:.7f},{lat:.7f},{height:.2f}"
        for lon, lat, height in zip(
            _east(track.lon_rad[rows]), track.lat_rad[rows] / DEG, track.height_m[rows]
        )
    )
    begin, end = (_when(start_utc, track.time_s[k]) for k in (0, -1))
    return (
        f"<Placemark><name>{_text(NAMES[track.key])}</name>"
        f"<TimeSpan><begin>{begin}</begin><end>{end}</end></TimeSpan>"
        f"<styleUrl>#{track.key}</styleUrl>"
        f"<LineString><tessellate>1</tessellate><altitudeMode>{mode}</altitudeMode>"
        f"<coordinates>{where}</coordinates></LineString></Placemark>"
    )


def _points(result: ReplayResult, best: Track, mode: str) -> list[str]:
    """Start, end and the stops in between, on the best track."""
    start_s, end_s = float(best.time_s[0]), float(best.time_s[-1])
    marks = [("start", start_s, "of the track"), ("end", end_s, "of the track")]
    marks += [
        (f"stop {k}", a, f"stands for {b - a:.0f} s")
        for k, (a, b) in enumerate(_stops(result, start_s), start=1)
    ]
    found = []
    for name, time_s, about in marks:
        columns = (best.lat_rad, np.unwrap(best.lon_rad), best.height_m)
        lat, lon, height = (float(np.interp(time_s, best.time_s, column)) for column in columns)
        where = f"{_east(np.array([lon]))[0]:.7f},{lat / DEG:.7f},{height:.2f}"
        found.append(
            f"<Placemark><name>{_text(name)}</name>"
            f"<description>{_text(f'{about}; {time_s:.1f} s of the log')}</description>"
            f"<TimeStamp><when>{_when(result.run.header.start_utc, time_s)}</when></TimeStamp>"
            f"<Point><altitudeMode>{mode}</altitudeMode><coordinates>{where}</coordinates></Point></Placemark>"
        )
    return found


def _stops(result: ReplayResult, start_s: float) -> Sequence[tuple[float, float]]:
    """Stands that begin after the start: the aided solution's, else those of the first flight."""
    if result.aided is not None and result.aided.history is not None:
        spans: Sequence[tuple[float, float]] = result.aided.stands
    else:
        spans = [(s.start_s, s.end_s) for t in result.tables[:1] for s in t.stops]
    return [(a, b) for a, b in spans if a > start_s]


def _east(lon_rad: NDArray) -> NDArray:
    """Longitude in [-180, 180] deg."""
    return np.asarray((lon_rad / DEG + 180.0) % 360.0 - 180.0)


def _when(start_utc: str, time_s: float) -> str:
    return (utc(start_utc) + timedelta(seconds=float(time_s))).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _text(free: str) -> str:
    """Escaped, without the control characters that XML 1.0 cannot hold."""
    allowed = (
        c
        for c in free
        if c in "\t\n\r" or " " <= c <= "\ud7ff" or "\ue000" <= c <= "\ufffd" or c > "\uffff"
    )
    return escape("".join(allowed))
