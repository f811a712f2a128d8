"""`watch`: a session while it runs, recorded first, estimated on the way, updated at its end."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from ins.json_file import read_toml
from ins.records import InputError, RunHeader
from recal.service.convert import map_errors
from recal.service.inputs.records import AnyTwin
from recal.service.inputs.unit_inputs import open_store
from recal.service.update import Update, UpdateRequest, update_in_store
from recal.service.watch.interim import InterimRequest
from recal.service.watch.monitor import Monitor
from recal.service.watch.recording import Recording
from recal.service.watch.records import WatchState
from recal.service.watch.worker import Worker
from trajectories.readers.conversion import run_header
from trajectories.readers.live.mavlink_source import Fix, MavlinkSource
from trajectories.readers.live.rows import Source
from trajectories.readers.live.text_source import RunSource, TableSource
from trajectories.readers.rows.column_map import SITE_KEYS, LogOptions
from trajectories.runs.directory import inspect_run

SHOWN_S = 1.0  # how often rows go to the disk and the state is told: a kill costs 1 s
WAIT_S = 0.2  # for rows
FIX_S = 10.0  # of messages in which a first fix is waited for: 10 of one a second
PORTS = ("udp:", "tcp:", "serial:")


@dataclass(frozen=True, kw_only=True)
class WatchRequest:
    """A session to watch.

    Parameters
    ----------
    source : str
        A run directory or a table of text that grows; - for standard input; udp:HOST:PORT,
        tcp:HOST:PORT or serial:DEVICE:BAUD for MAVLink.
    run : path
        The run directory to record to; one that this command began goes on. After a gap of more
        than 1 s the run goes on as run-2.
    serial : str, optional
        Serial number of the unit. Default: the source's.
    technology : str, optional
        Technology of the unit's gyros. Default: the source's, else that of the serial in the store.
    lat_deg : float, optional
        Latitude where the session starts [deg]. Default: the source's, else that of the first fix.
    map_ : path, optional
        Column map (TOML) of a table. Default: none, the names of a run's columns.
    target_deg_h : float in [0, ]
        Sigma that each gyro is to reach [deg/h]. Default: half of what the table claims.
    idle_s : float in [0, ]
        End the session when no row has come for so long [s]. Default: never.
    commit : bool
        Store the new table. Default: only report it.
    propose : (str, str), optional
        Who proposes and their note: the new table is kept for review, the active one stays.
    stopped : callable
        Whether the session is to end now.
    shown, told : callable
        Given the state every second, and as each step of the update at the end begins; told of what
        happens.
    """

    source: str
    run: Path
    store_url: str
    serial: str | None = None
    technology: str | None = None
    lat_deg: float | None = None
    map_: Path | None = None
    target_deg_h: float | None = None
    idle_s: float | None = None
    commit: bool = False
    propose: tuple[str, str] | None = None
    store_named: bool = False
    new_unit: bool = False
    new_store: bool = False
    twin: AnyTwin | None = None
    config: Path | None = None
    thermal_model: Path | None = None
    output: Path | None = None
    stopped: Callable[[], bool] = field(default=lambda: False)
    shown: Callable[[WatchState], None] = field(default=lambda state: None)
    told: Callable[[str], None] = field(default=lambda line: None)


def watch(request: WatchRequest) -> Update:
    """Record a session, say what it shows while it runs, and update the unit's table at its end.

    Parameters
    ----------
    request : WatchRequest
        The session.

    Returns
    -------
    Update
        That of `update_in_store` on the recorded run, bit by bit.

    Raises
    ------
    InputError
        Where the source cannot be read, the run cannot be written (what was recorded stays), or
        nothing was recorded.
    """
    source = opened(request)
    recording = Recording(source, request.run)
    try:
        with map_errors(request.map_):
            last = _follow(request, source, recording)
    finally:
        recording.close()
        source.close()
    if not recording.parts:
        raise InputError(f"{request.source}: no row of an imu came, nothing was recorded")
    return update_in_store(
        UpdateRequest(
            runs=_readable(recording.parts, request.told),
            store_url=request.store_url,
            store_named=request.store_named,
            commit=request.commit,
            propose=request.propose,
            new_unit=request.new_unit,
            new_store=request.new_store,
            twin=request.twin,
            config=request.config,
            thermal_model=request.thermal_model,
            output=request.output,
            keep_earlier=True,
            told=request.told,
            step=lambda words: request.shown(replace(last, ending=words)),
        )
    )


def _readable(parts: list[Path], told: Callable[[str], None]) -> list[Path]:
    """The parts that are runs; all of them where none is, so that the update says why."""
    if len(parts) == 1:
        return parts
    good = []
    for part in parts:
        found = inspect_run(part)
        if found.run is None:
            told(f"{part}: left out: {found.errors[0]}")
        else:
            good.append(part)
    return good or parts


def _follow(request: WatchRequest, source: Source, recording: Recording) -> WatchState:
    """Record and show until the source ends, falls silent, or the session is stopped; the state
    then.
    """
    monitor, worker = Monitor(), Worker(_interim(request))
    came_s = shown_s = time.monotonic()
    request.shown(_state(monitor, recording, worker, 0.0))
    try:
        while not request.stopped():
            batch = source.read(WAIT_S)
            if batch is None:
                break
            monitor.take(recording.take(batch))
            now_s = time.monotonic()
            if batch:
                came_s = now_s
            else:
                time.sleep(WAIT_S)
            silent = request.idle_s is not None and now_s - came_s > request.idle_s
            if silent and recording.parts:  # all of its rows may have been recorded before a kill
                break
            worker.look(monitor.time_s, recording.parts)
            if now_s - shown_s >= SHOWN_S:
                shown_s = now_s
                recording.sync()
                request.shown(_state(monitor, recording, worker, now_s - came_s))
    finally:
        worker.close()
    return _state(monitor, recording, worker, 0.0)


def _interim(request: WatchRequest) -> InterimRequest:
    return InterimRequest(
        store_url=request.store_url,
        twin=request.twin,
        config=request.config,
        thermal_model=request.thermal_model,
        target_deg_h=request.target_deg_h,
    )


def _state(monitor: Monitor, recording: Recording, worker: Worker, silent_s: float) -> WatchState:
    estimate = worker.found
    faults = [*monitor.faults(silent_s), *worker.faults]
    return WatchState(
        runs=[str(part) for part in recording.parts],
        time_s=monitor.time_s,
        rate_hz=monitor.rate_hz,
        phase=monitor.phase.value,
        rows=monitor.rows,
        dropped={str(k): n for k, n in recording.dropped.items() if n},
        gyro_degC=[] if monitor.gyro_degC is None else monitor.gyro_degC.tolist(),
        visited_degC=[] if monitor.gyro_degC is None else monitor.visited_degC.tolist(),
        faults=[*faults, *(estimate.faults if estimate is not None else ())],
        estimate=estimate,
    )


def opened(request: WatchRequest) -> Source:
    """The source by its name. InputError where it cannot be had."""
    name = request.source
    if name.startswith(PORTS):
        return MavlinkSource(name, _ByFix(request))
    if name == "-":
        return _table(request, None)
    path = Path(name)
    if path.is_dir():
        return RunSource(path)
    if not path.is_file():
        raise InputError(f"{path}: no run directory, no file, and none of - {' '.join(PORTS)}")
    return _table(request, path)


def _table(request: WatchRequest, path: Path | None) -> TableSource:
    options = {} if request.map_ is None else read_toml(request.map_)
    return TableSource(path, LogOptions(options), partial(header_of, request))


class _ByFix:
    """The header of a MAVLink session: its place given, else that of the first fix."""

    def __init__(self, request: WatchRequest) -> None:
        self._request, self._since_s = request, time.monotonic()

    def __call__(self, fix: Fix | None, begun: bool) -> RunHeader | None:
        if not begun:
            self._since_s = time.monotonic()
            return None
        if self._request.lat_deg is None and fix is None:
            if time.monotonic() - self._since_s < FIX_S:
                return None
            raise InputError(f"no fix in {FIX_S:.0f} s: needed --lat-deg")
        site = {}
        if fix is not None:
            place = dict(zip(("lat_deg", "lon_deg", "height_m"), fix))
            site = {**place, "sigma_lat_deg": 0.001, "lat_source": "receiver"}
        return header_of(self._request, LogOptions({"site": site}))


def header_of(request: WatchRequest, said_by_source: LogOptions) -> RunHeader:
    """run.json of what the options say over what the source says. InputError names what is
    missing.
    """
    said = {"start_utc": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}", **said_by_source.keys}
    place = {key: said.pop(key) for key in SITE_KEYS if key in said}
    said["site"] = {**said.get("site", {}), **place}
    serial = request.serial or said.get("imu_serial")
    technology = request.technology or said.get("gyro_technology")
    given = {
        "imu_serial": serial,
        "gyro_technology": technology or _technology(request.store_url, serial),
        "lat_deg": request.lat_deg,
    }
    mapped = LogOptions({} if request.map_ is None else {"run": said})
    return run_header(said, given, request.run.name, options=mapped)


def _technology(store_url: str, serial: str | None) -> str | None:
    """Of the unit with this serial, where the store holds one alone."""
    store = open_store(store_url)
    if store is None or serial is None:
        return None
    with store:
        found = {u.unit for u in store.overview() if u.unit.imu_serial == serial}
    return found.pop().gyro_technology if len(found) == 1 else None
