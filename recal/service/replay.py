"""`replay`: navigate a log with the stored table and with the one before it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from alignment.motion.kinds import Witness
from infield.aided.flight import AidedResult, Aiding, Vehicle
from infield.aided.reasons import AidedGrade
from infield.aided.taken import UNKNOWN, TypeShare
from infield.replay.free_inertial import ReplayResult, TableChoice
from infield.replay.free_inertial import replay as replay_run
from infield.reports.documents.aided import (
    AidedDocument,
    AidedFlightDocument,
    SmoothedDocument,
    aided_columns,
    smoothed_result,
)
from infield.reports.documents.replay import FlownTableDocument, ReplayDocument, replay_document
from infield.reports.replay_page import render, verdict_words
from infield.reports.track_kml import track_kml
from infield.store.table_store import TableStore
from ins.attitude import euler_from_dcm
from ins.records import InputError, Run
from ins.units import DEG
from recal.service.inputs.records import AnyRun, AnyTable, AnyTwin, runs_of
from recal.service.inputs.unit_inputs import UnitInputs, given_unit, opened, with_thermal_model
from recal.service.results.files import AnyPath, program_version
from recal.service.results.result import Result, write_report
from trajectories.runs.directory import read_reference
from trajectories.runs.stream_files import write_columns

WEAK_TOLD = 4  # chosen: 4 stretches are told on the terminal, replay.json holds all
ATTITUDE_COLUMNS = ("roll_deg", "pitch_deg", "heading_deg")


@dataclass(frozen=True, kw_only=True)
class Aided:
    """What is asked of the flight with GNSS.

    Parameters
    ----------
    outages : sequence of (float, float)
        Start and length [s] of stretches whose fixes are left out, and score the solution.
    smooth : bool
        Also write the aided solution that all fixes make, those to come included.
    vehicle : {'car', 'find', 'other'}
        `car`: held by its wheels (no velocity to the side or upward, an odometer's speed), unless
        the fixes contradict them; `find`: the same, where the log shows that it rolls and does not
        bank; `other`: neither.
    """

    outages: Sequence[tuple[float, float]] = ()
    smooth: bool = False
    vehicle: str = Vehicle.OTHER


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class Replayed(Result[ReplayDocument]):
    """A log flown again, with each table.

    Parameters
    ----------
    flown : ReplayResult
        The solutions.
    """

    flown: ReplayResult

    @property
    def drift_nm_h(self) -> dict[str, float]:
        """Parked drift of the free-inertial solution [NM/h], by the table's role."""
        return {t.role: t.parked.rate_nm_h for t in self.record.tables if t.parked is not None}

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Verdict, drift with each table, the aided solution."""
        return summary(self.record)

    def write(self, output: AnyPath | None = None, *, kml: bool = False, csv: bool = False) -> Path:
        """Write replay.json, replay.html, navigation.parquet and navigation_aided.parquet; where it
        was asked for, navigation_smoothed.parquet.

        Parameters
        ----------
        output : str or path, optional
            A directory, made if need be; else `recal-replay`.
        kml : bool
            Also track.kml, for a globe.
        csv : bool
            Also the navigation files as CSV.

        Returns
        -------
        Path
            The directory.
        """
        more = {"track.kml": track_kml(self.flown)} if kml else {}
        directory = write_report(self, output or "recal-replay", "replay", more)
        for ending in (".parquet", ".csv") if csv else (".parquet",):
            _write_navigation(directory / f"navigation{ending}", self.flown)
            flown = self.flown.aided
            _write_aided(directory / f"navigation_aided{ending}", flown)
            best = None if flown is None else smoothed_result(flown)
            _write_aided(directory / f"navigation_smoothed{ending}", best)
        return directory


def replay(
    run: AnyRun,
    table: AnyTable | None = None,
    twin: AnyTwin | None = None,
    *,
    store: TableStore | str | None = None,
    thermal_model: AnyPath | None = None,
    aided: bool | Sequence[tuple[float, float]] | Aided = True,
    told: Callable[[str], None] = lambda words: None,
) -> Replayed:
    """Navigate a run again, free-inertial and with its GNSS.

    Parameters
    ----------
    run : Run or path
        One power-on session; only a directory has a reference to score with.
    table : ThermalTable or path, optional
        The table to fly with; else the store's active and previous one, else bias 0.
    twin : TwinModel or path, optional
        Noise model; else the store's, else the defaults of the technology.
    store : str or TableStore, optional
        SQLAlchemy URL, or a store that is open.
    thermal_model : path, optional
        A fitted thermal_rlg.json or thermal_fog.json, taken out of the log first.
    aided : bool or sequence of (float, float)
        Also navigate with the run's GNSS, where it has one; a sequence: start and length [s] of
        stretches whose fixes are left out of that solution, which is then scored with them. An
        `Aided` also asks for the smoothed solution.
    told : callable
        Told what is being done.

    Returns
    -------
    Replayed
        Drift [NM/h] with each table, the aided solution; `.write(folder)` writes all files.

    Raises
    ------
    InputError
        Where an input cannot be read, or the inputs are of different units.

    Examples
    --------
    >>> import recal
    >>> simulated = recal.simulate("parked_only", seed=7, rate_hz=10)
    >>> flown = recal.replay(simulated.run, simulated.table, simulated.twin)
    >>> flown.verdict, list(flown.drift_nm_h)
    ('replayed', ['active'])
    """
    told("reading the run")
    reference = None if isinstance(run, Run) else read_reference(Path(run))
    (read,) = runs_of(run)
    if not isinstance(aided, bool) and read.gnss is None:
        raise InputError(
            "outage, smooth, vehicle: the run has no satellite fixes, needed for an aided flight"
        )
    database = opened(store)
    model = None if thermal_model is None else Path(thermal_model)
    unit, (read,), use = with_thermal_model(given_unit(read, table, twin, database), [read], model)
    tables, notes = _choices(read, unit, database)
    result = replay_run(
        read,
        tables,
        unit.twin,
        reference=reference,
        aided=_asked(aided),
        applied_table=(lambda sha256: database.by_sha256(sha256).table) if database else None,
        told=told,
    )
    said = use(tables[0].table) if tables[0].table is not None else None
    noise = unit.noise_note([run])
    document = replay_document(
        result,
        unit.twin,
        store=database.name if database else None,
        version=program_version(),
        notes=(*notes, *([noise] if noise else ()), *(said.text if said else ())),
        thermal_model=said,
        reference=reference,
    )
    found = replace(document, noise_source=unit.noise_source)
    return Replayed(found, page=lambda: render(found), flown=result)


def _asked(aided: bool | Sequence[tuple[float, float]] | Aided) -> bool | Aiding:
    """The same in the terms of the flight: start and end of each stretch."""
    if isinstance(aided, bool):
        return aided
    given = aided if isinstance(aided, Aided) else Aided(outages=aided)
    spans = tuple((start_s, start_s + length_s) for start_s, length_s in given.outages)
    kinds = [str(kind) for kind in Vehicle]
    if given.vehicle not in kinds:
        raise InputError(f"vehicle {given.vehicle!r}, needed one of {', '.join(kinds)}")
    return Aiding(left_out=spans, smooth=given.smooth, vehicle=Vehicle(given.vehicle))


def _choices(
    run: Run, unit: UnitInputs, database: TableStore | None
) -> tuple[list[TableChoice], tuple[str, ...]]:
    """The tables to fly with, active first, and what there is to say of them."""
    if unit.given:
        return [TableChoice(role="active", table=unit.table, origin="the table given")], ()
    header = run.header
    if database is None or not unit.known:
        why = (
            "no store there"
            if database is None
            else f"the store does not know unit {header.imu_serial}"
        )
        seeded = "thermal_model_sha256" in unit.table.provenance  # unit_inputs.with_thermal_model
        origin = (
            "settled part of the thermal model"
            if seeded
            else f"default of a {header.gyro_technology} unit (bias 0)"
        )
        return [TableChoice(role="active", table=unit.table, origin=origin)], (
            f"{why}: its table is the {origin}",
        )
    key = (header.imu_serial, header.gyro_technology, header.gyro_mode)
    found = [("active", database.active(*key)), ("previous", database.previous(*key))]
    tables = [
        TableChoice(
            role=role,
            table=r.table,
            origin=f"revision {r.number} ({r.kind})",
            sha256=r.sha256,
            revision=r.number,
        )
        for role, r in found
        if r is not None
    ]
    only = f"the store holds one revision of unit {header.imu_serial}: nothing to compare it with"
    return tables, () if len(tables) == 2 else (only,)


def _write_navigation(path: Path, result: ReplayResult) -> None:
    """The solutions at 1 Hz, one below the other; a file of an earlier replay goes where nothing
    was flown.
    """
    flown = [t for t in result.tables if t.history is not None]
    if not flown:
        path.unlink(missing_ok=True)
        return
    parts = []
    for t in flown:
        h = t.history
        assert h is not None
        attitude = dict(zip(ATTITUDE_COLUMNS, (angle / DEG for angle in euler_from_dcm(h.C_nb))))
        velocity = dict(zip(("vn_m_s", "ve_m_s", "vd_m_s"), h.v_n_m_s.T))
        parts.append(
            {
                "time_s": h.time_s,
                "lat_deg": h.lat_rad / DEG,
                "lon_deg": h.lon_rad / DEG,
                "height_m": h.height_m,
                **velocity,
                **attitude,
                "table": np.full(h.time_s.size, t.choice.role),
            }
        )
    write_columns(path, {name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def _write_aided(path: Path, aided: AidedResult | None) -> None:
    """An aided solution with its sigmas at 1 Hz; an earlier file goes where there is none."""
    if aided is None or aided.history is None:
        path.unlink(missing_ok=True)
        return
    write_columns(path, aided_columns(aided))


def summary(document: ReplayDocument) -> list[str]:
    """The result in a few lines for people."""
    lines = [f"{document.run_id}: {verdict_words(document)}"]
    lines += [f"  because {reason}" for reason in document.reasons]
    lines += [f"  {note}" for note in document.notes]
    for t in document.tables:
        drift, predicted = t.parked, t.predicted
        line = f"  {t.role:9s}{t.origin}: "
        if drift is None:
            lines.append(line + f"alignment {t.alignment.verdict}, no parked drift")
            continue
        expected = f" (predicted 1 sigma {predicted.sigma_nm_h:.3f})" if predicted else ""
        lines.append(
            line + f"{drift.rate_nm_h:.3f} NM/h{expected}, RMS rate {drift.rms_rate_nm_h:.3f}"
            " NM/h, "
            f"{drift.end_speed_kt:.2f} kt, class {drift.drift_class}{_realign(t)}"
        )
        if (schuler := t.schuler) and not schuler.reason:
            lines.append(
                f"           Schuler period {schuler.period_min:.1f} +-"
                f" {schuler.sigma_period_min:.1f} min"
            )
    difference = document.difference
    if difference and (rate := difference.rate_nm_h):
        sigma = difference.sigma_rate_nm_h
        spread = "" if sigma is None else f" +- {sigma:.3f}"
        lines.append(
            f"  previous to active: {rate.previous:.3f} -> {rate.active:.3f} NM/h, change"
            f" {rate.change:+.3f}{spread}, heading {difference.heading_mrad:+.2f} mrad"
        )
    return lines + _aided_lines(document.aided)


def _realign(table: FlownTableDocument) -> str:
    if not table.realign:
        return ""
    return ", REALIGN" + (
        " by a stop that the IMU alone sees" if list(table.realign_at) == [Witness.ROWS] else ""
    )


def _bad_by_type(shares: Sequence[TypeShare]) -> str:
    """How many fixes of each type were bad; empty where no type is known."""
    if all(share.fix_type == UNKNOWN for share in shares):
        return ""
    told = [f"{share.bad} of {share.count} (type {share.fix_type})" for share in shares]
    return "; bad fixes: " + ", ".join(told)


def _smoothed_lines(smoothed: SmoothedDocument | None) -> list[str]:
    """What smoothing brought."""
    if smoothed is None:
        return []
    level, heading = smoothed.sigma_level_m, smoothed.sigma_heading_deg
    was_level, was_heading = smoothed.filter_sigma_level_m, smoothed.filter_sigma_heading_deg
    return [
        f"    smoothed: sigma level at most {level['largest']:.3g} m (filter"
        f" {was_level['largest']:.3g}), median {level['median']:.3g} m"
        f" ({was_level['median']:.3g}); heading at the start {heading['first']:.3g} deg"
        f" ({was_heading['first']:.3g}), median {heading['median']:.3g} deg"
        f" ({was_heading['median']:.3g})",
        *(
            f"    smoothed, fixes from {o.start_s:.1f} to {o.end_s:.1f} s left out: level error RMS"
            f" {o.rms_level_m:.3g} m, error over sigma {o.error_over_sigma:.2f}"
            for o in smoothed.outage_scores
        ),
    ]


def _aided_lines(aided: AidedDocument | None) -> list[str]:
    """The aided solution in a few lines."""
    if aided is None:
        return []
    degraded = isinstance(aided, AidedFlightDocument) and aided.grade is AidedGrade.DEGRADED
    head = [f"  aided: {aided.verdict}{', degraded in parts' if degraded else ''}"]
    head += [f"    because {reason}" for reason in aided.reasons]
    head += [f"    {note}" for note in aided.notes]
    if not isinstance(aided, AidedFlightDocument):
        return head
    start, end, nis, fixes = aided.start, aided.end, aided.consistency, aided.fixes
    level = max(end["sigma_north_m"], end["sigma_east_m"])
    head += [
        f"    degraded from {w.start_s:.1f} to {w.end_s:.1f} s: {w.words}"
        for w in aided.degraded[:WEAK_TOLD]
    ]
    if len(aided.degraded) > WEAK_TOLD:
        head.append(f"    and {len(aided.degraded) - WEAK_TOLD} more stretches in replay.json")
    head += [
        f"    {o.fixes} fixes from {o.start_s:.1f} to {o.end_s:.1f} s left out: level error RMS"
        f" {o.rms_level_m:.3g} m, at the end {o.end_level_m:.3g} m (1 sigma"
        f" {o.sigma_end_level_m:.3g} m), error over sigma {o.error_over_sigma:.2f}"
        for o in aided.outage_scores
    ]
    head += _smoothed_lines(aided.smoothed)
    return head + [
        (
            f"    from {start.time_s:.1f} s by {start.method}; {fixes.used_position} fixes"
            f" used, {fixes.rejected_position} positions and {fixes.rejected_velocity}"
            f" velocities rejected{_bad_by_type(fixes.by_type)}"
        ),
        (
            f"    NIS position {nis.position.nis_mean:.2f}, velocity"
            f" {nis.velocity.nis_mean:.2f}; at the end 1 sigma {level:.3g} m level, roll"
            f" {end['sigma_roll_deg']:.3g}, pitch {end['sigma_pitch_deg']:.3g}, heading"
            f" {end['sigma_heading_deg']:.3g} deg"
        ),
    ]
