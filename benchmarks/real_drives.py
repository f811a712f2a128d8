"""Aided replay of public logs that nobody here recorded or tuned for: what starts, what it says of
itself, and how far off it is where fixes are left out.

Nothing of a log is part of the project. The page is docs/real_logs.md.
"""

import subprocess
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.study import Record, Work, table
from infield.aided.flight import AidedResult, Aiding
from infield.replay.free_inertial import TableChoice, replay
from ins.attitude import dcm_from_euler, rotation_vector_from_dcm
from ins.filters.aided_filter import level_sigmas
from ins.records import InputError, Run
from ins.twin_file import default_twin
from ins.units import DEG
from ins.verdicts import sentences
from trajectories.readers.containers import dataflash
from trajectories.readers.conversion import Conversion, convert_log
from trajectories.readers.formats import ardupilot
from trajectories.readers.rows.row_cleaning import LogGapError

ERLE, ERLE_COMMIT = "erlerobot/logs", "3f7d4a0d17f2485f7fa5cb7124fc2a5b13d6c688"
DIAGNOSIS = "BeastAyyG/ardupilot-log-diagnosis"
DIAGNOSIS_COMMIT = "79fad4ee5963c830f90ebad199a4c592ab26022b"
# receivers of these logs give no week: the day in their path
NO_DATE_UTC = "2014-09-07T12:00:00Z"
COPTERS = (
    "09-10-2014/25.BIN",
    "09-10-2014/30.BIN",
    "09-10-2014/31.BIN",
    "10-11-2014/103.BIN",
    "10-11-2014/104.BIN",
    "10-11-2014/105.BIN",
    "11-2-2015/112.BIN",
    "14-11-2014/118.BIN",
    "15-12-2014/16.BIN",
    "22-12-2014/37.BIN",
    "26-11-2014/181.BIN",
    "31-3-2015/83.BIN",
    "5-12-2014/218.BIN",
    "6-11-2014/GPS_issues1.BIN",
    "6-11-2014/GPS_issues2.BIN",
    "6-11-2014/GPS_issues3.BIN",
    "6-11-2014/Loiter_RTL.bin",
    "7-9-2014/6.BIN",
    "7-9-2014/21.BIN",
    "7-9-2014/25.BIN",
    "8-10-2014/10.BIN",
    "8-10-2014/11.BIN",
)
PLANES = ("4-12-2014/329.BIN", "5-12-2014/05_12_2014_E.BIN")
MECHANICAL = (
    "data/clean_imports/background_expert_01/benchmark_ready/dataset/"
    "log_0036_mechanical_failure.bin"
)
SHORT_S, LONG_S = 30.0, 60.0  # of the outages
LEAST_S = 90.0  # of solution, for an outage; 240 s for the long one besides
LONG_LEAST_S = 240.0


@dataclass(frozen=True)
class Source:
    """A log of a public repository."""

    repository: str
    commit: str
    path: str
    vehicle: str

    @property
    def name(self) -> str:
        return self.path.replace("/", "_")

    def fetched(self, folder: Path, clones: Path | None) -> Path:
        """The log in a folder, brought there if need be."""
        path = folder / self.name
        if path.exists():
            return path
        folder.mkdir(parents=True, exist_ok=True)
        if clones is not None:
            clone = clones / self.repository.replace("/", "+") / "repo"
            blob = f"{self.commit}:{self.path}"
            path.write_bytes(
                subprocess.run(
                    ["git", "-C", str(clone), "show", blob], check=True, capture_output=True
                ).stdout
            )
            return path
        url = f"https://raw.githubusercontent.com/{self.repository}/{self.commit}/{self.path}"
        with urllib.request.urlopen(url) as answer:
            path.write_bytes(answer.read())
        return path


@dataclass(frozen=True, kw_only=True)
class Row:
    """What came out of a log; what is None does not apply."""

    name: str
    vehicle: str
    seconds: float
    fixes: int
    verdict: str
    grade: str | None = None
    why: str = ""
    start_s: float | None = None
    method: str | None = None
    sigma_start_deg: float | None = None
    sigma_end_deg: float | None = None
    att_heading_deg: float | None = None
    att_tilt_deg: float | None = None
    outages: tuple[tuple[float, float, float, float], ...] = ()
    smoothed: tuple[tuple[float, float, float], ...] = ()
    cpu_s: float = 0.0


def sources() -> Iterator[Source]:
    """The logs, one after the other."""
    for path in COPTERS:
        yield Source(ERLE, ERLE_COMMIT, f"pxf/copter/{path}", "copter")
    for path in PLANES:
        yield Source(ERLE, ERLE_COMMIT, f"pxf/plane/{path}", "plane")
    yield Source(DIAGNOSIS, DIAGNOSIS_COMMIT, MECHANICAL, "copter")


def converted(path: Path) -> Conversion:
    """The log, or its longest stretch between gaps, as `recal convert --split` takes it."""
    try:
        return dated(path, {})
    except LogGapError as gaps:
        from_s, to_s = max(gaps.stretches, key=lambda s: s[1] - s[0])
        return dated(path, {"from_s": from_s, "to_s": to_s})


def dated(path: Path, options: dict[str, float]) -> Conversion:
    """The log, with a date where its receiver gave none."""
    try:
        return convert_log(path, options, {})
    except LogGapError:
        raise
    except InputError:
        return convert_log(path, options, {"start_utc": NO_DATE_UTC})


def fly(run: Run, outages: tuple[tuple[float, float], ...]) -> AidedResult | None:
    table = [TableChoice(role="active", table=None, origin="none")]
    twin = default_twin(run.header.gyro_technology)
    asked = Aiding(left_out=outages, smooth=bool(outages))
    return replay(run, table, twin, aided=asked).aided


def stretches(first_s: float, last_s: float) -> tuple[tuple[float, float], ...]:
    """Where fixes are left out of a solution from first_s to last_s: at 45 %, and at 65 % of long
    ones.
    """
    length_s = last_s - first_s
    if length_s < LEAST_S:
        return ()
    short_s = first_s + 0.45 * length_s
    found = [(short_s, short_s + SHORT_S)]
    if length_s >= LONG_LEAST_S:
        long_s = first_s + 0.65 * length_s
        found.append((long_s, long_s + LONG_S))
    return tuple(found)


def measured(source: Source, path: Path) -> Row:
    """What comes out of a log."""
    began = time.process_time()
    head = {"name": source.path, "vehicle": source.vehicle}
    try:
        made = converted(path)
    except InputError as error:
        return Row(**head, seconds=0.0, fixes=0, verdict="not converted", why=str(error))
    run = made.run
    count = 0 if run.gnss is None else run.gnss.time_s.size
    found = fly(run, ())
    head |= {"seconds": run.imu.end_s, "fixes": count}
    if found is None:
        return Row(**head, verdict="no fixes")
    if found.history is None or found.found is None:
        return Row(**head, verdict=found.verdict, why="; ".join(sentences(found.reasons)))
    history = found.history
    cpu_s = time.process_time() - began
    att = compared(found, path, float(made.record.time_shift_s))
    first_s, last_s = float(history.time_s[0]), float(history.time_s[-1])
    left_out = stretches(first_s, last_s)
    scored = fly(run, left_out) if left_out else None
    sigma = np.degrees(np.sqrt(history.phi_covariance[:, 2, 2]))
    return Row(
        **head,
        verdict=found.verdict,
        grade=found.grade,
        why="; ".join([*sentences(found.reasons), *sorted({str(w.why) for w in found.weak})]),
        start_s=first_s,
        method=found.found.method,
        sigma_start_deg=float(np.degrees(found.found.sigma_heading_rad)),
        sigma_end_deg=float(sigma[-1]),
        att_heading_deg=None if att is None else float(att.median_deg[2]),
        att_tilt_deg=None if att is None else float(np.hypot(*att.median_deg[:2])),
        outages=tuple(
            (o.end_s - o.start_s, o.end_level_m, o.sigma_end_level_m, o.error_over_sigma)
            for o in (scored.outage_scores if scored else ())
        ),
        smoothed=tuple(
            (was.rms_level_m, now.rms_level_m, now.error_over_sigma)
            for was, now in (
                zip(scored.outage_scores, scored.smoothed_scores, strict=True) if scored else ()
            )
        ),
        cpu_s=cpu_s,
    )


FLYING_M_S = 5.0


@dataclass(frozen=True)
class Against:
    """Aided less ATT while flying: median and RMS of the rotation about north, east, down [deg];
    median sigmas [deg].
    """

    median_deg: NDArray
    rms_deg: NDArray
    sigma_deg: NDArray
    seconds: int


def logged_attitude(path: Path) -> tuple[NDArray, NDArray]:
    """Times in the log's own clock [s] and roll, pitch, yaw (n, 3) [rad] of its ATT messages."""
    read = dataflash.read_tables if dataflash.is_dataflash(path) else ardupilot.mat_tables
    table = read(path, {"ATT"})[0]["ATT"]
    name, factor = ("TimeUS", 1e-6) if "TimeUS" in table else ("TimeMS", 1e-3)
    angles = np.column_stack([np.asarray(table[k], dtype=float) for k in ("Roll", "Pitch", "Yaw")])
    return np.asarray(table[name], dtype=float) * factor, angles * DEG


def against_att(result: AidedResult, time_s: NDArray, euler_rad: NDArray) -> Against:
    """What the two attitudes differ by; time_s on the run's clock."""
    history = result.history
    assert history is not None
    k = np.clip(np.searchsorted(time_s, history.time_s), 0, time_s.size - 1)
    off = (
        rotation_vector_from_dcm(history.C_nb @ np.swapaxes(dcm_from_euler(*euler_rad[k].T), 1, 2))
        / DEG
    )
    flying = np.linalg.norm(history.v_n_m_s[:, :2], axis=1) > FLYING_M_S
    sigma = level_sigmas(history.phi_covariance, history.C_nb) / DEG
    return Against(
        median_deg=np.median(np.abs(off[flying]), axis=0),
        rms_deg=np.sqrt(np.mean(off[flying] ** 2, axis=0)),
        sigma_deg=np.median(sigma[flying], axis=0),
        seconds=int(flying.sum()),
    )


def compared(found: AidedResult, path: Path, shift_s: float) -> Against | None:
    """Against the autopilot's own attitude, where it logs one and the vehicle is fast enough."""
    try:
        time_s, euler = logged_attitude(path)
        against = against_att(found, time_s - shift_s, euler)
    except (InputError, KeyError):
        return None
    return against if against.seconds >= 5 else None


HEAD = (
    "log",
    "vehicle",
    "s",
    "verdict",
    "starts at, s",
    "heading sigma: start, end, deg",
    "off the autopilot: tilt, heading, deg",
    "outages: length, error, sigma, m (error/sigma)",
    "CPU s",
)


def cells(r: Record) -> list[str]:
    """A row of the table."""
    begin = [f"`{r['name']}`", r["vehicle"], f"{r['seconds']:.0f}"]
    if r["start_s"] is None or r["sigma_start_deg"] is None:
        return [*begin, f"{r['verdict']}: {r['why']}", "", "", "", "", ""]
    outages = "; ".join(
        f"{length:.0f} s: {end:.1f}, {sigma:.1f} ({ratio:.2f})"
        for length, end, sigma, ratio in r["outages"]
    )
    att = ""
    if r["att_heading_deg"] is not None:
        att = f"{r['att_tilt_deg']:.1f}, {r['att_heading_deg']:.1f}"
    told = f"{r['verdict']}, {r['grade']}" + (f" ({r['why']})" if r["why"] else "")
    start = f"{r['start_s']:.0f}, {r['method']}"
    sigmas = f"{r['sigma_start_deg']:.1f}, {r['sigma_end_deg']:.1f}"
    return [*begin, told, start, sigmas, att, outages, f"{r['cpu_s']:.1f}"]


def drive(name: str, logs: str, clones: str) -> Record:
    """What comes out of a log, by its path."""
    source = next(s for s in sources() if s.path == name)
    path = source.fetched(Path(logs), Path(clones) if clones else None)
    return asdict(measured(source, path))


def run(work: Work, *, logs: Path, clones: str = "") -> str:
    """logs: folder of the logs; what is missing there is downloaded, or taken from clones named
    OWNER+NAME/repo in the folder `clones`.
    """
    found = work.each(drive, [(source.path, str(logs), clones) for source in sources()])
    late = [
        (row["name"], f"{was:.1f}", f"{now:.1f} ({ratio:.2f})")
        for row in found
        for was, now, ratio in row["smoothed"]
    ]
    level = ("log", "level RMS in an outage, m", "smoothed, m (error over sigma)")
    return table(HEAD, [cells(row) for row in found]) + "\n" + table(level, late)
