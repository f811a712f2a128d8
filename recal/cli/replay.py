"""`recal replay`: navigate a log with the stored table and with the one before it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recal.cli.console import (
    DEFAULT_STORE,
    JsonFlag,
    NoSeed,
    OutputPath,
    Quiet,
    StoreUrl,
    ThermalModelPath,
    Verbose,
    answer,
    finish,
    result_text,
    say,
)

if TYPE_CHECKING:
    from infield.replay.free_inertial import ReplayResult, TableChoice
    from infield.store.table_store import TableStore
    from ins.records import Run
    from recal.service.unit_inputs import UnitInputs

NAVIGATION = ("roll_deg", "pitch_deg", "heading_deg")


def command(
    run: Annotated[Path, typer.Argument(help="Run directory.")],
    store: StoreUrl = DEFAULT_STORE,
    twin: Annotated[Path | None, typer.Option("--twin", help="Noise model of the unit.")] = None,
    thermal_model: ThermalModelPath = None,
    aided: Annotated[
        bool,
        typer.Option(
            "--aided/--no-aided", help="Also navigate with the run's GNSS, where it has one."
        ),
    ] = True,
    kml: Annotated[bool, typer.Option("--kml", help="Also write track.kml, for a globe.")] = False,
    csv: Annotated[
        bool, typer.Option("--csv", help="Also write the navigation files as CSV.")
    ] = False,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Fly the log again with the stored table and with the one before it: drift in NM/h, old and
    new.

    Example: recal replay run-2 --store sqlite:///recal.db -o replay
    """
    document = replay(
        run,
        store_url=store,
        twin=twin,
        thermal_model=thermal_model,
        aided=aided,
        kml=kml,
        csv=csv,
        output=output,
    )
    answer(document, as_json=as_json, verbose=verbose)
    for line in summary(document):
        say(line, quiet=quiet)
    finish(document)


def replay(
    run_path: Path,
    *,
    store_url: str,
    twin: Path | None = None,
    thermal_model: Path | None = None,
    aided: bool = True,
    kml: bool = False,
    csv: bool = False,
    output: Path | None = None,
) -> dict[str, Any]:
    """Replay one run; writes replay.json, replay.html, navigation.parquet (free-inertial) and
    navigation_aided.parquet, each where there is such a solution; with `kml`, track.kml, with
    `csv`, the two as .csv; returns the document.
    """
    from infield.replay.free_inertial import replay as replay_run
    from infield.reports.documents.replay import replay_document
    from infield.reports.replay_page import render
    from infield.reports.track_kml import track_kml
    from ins.verdicts import plain
    from recal.service.output import output_directory, program_version, write_files
    from recal.service.unit_inputs import open_store, unit_inputs, with_thermal_model
    from trajectories.runs.directory import read_reference, read_run

    run, reference = read_run(run_path), read_reference(run_path)
    database = open_store(store_url)
    unit, (run,), use = with_thermal_model(unit_inputs(run, database, twin), [run], thermal_model)
    tables, notes = _choices(run, unit, database)
    result = replay_run(
        run,
        tables,
        unit.twin,
        reference=reference,
        aided=aided,
        applied_table=(lambda sha256: database.by_sha256(sha256).table) if database else None,
    )
    name = database.name if database else None
    said = use(tables[0].table) if tables[0].table is not None else None
    found = replay_document(
        result,
        unit.twin,
        store=name,
        version=program_version(),
        notes=(*notes, *(said["text"] if said else ())),
        thermal_model=said,
        reference=reference,
    )
    document = plain(found)
    directory = output_directory(output, "replay")
    texts = {
        directory / "replay.json": result_text(document),
        directory / "replay.html": render(found),
    }
    write_files(texts | ({directory / "track.kml": track_kml(result)} if kml else {}))
    for ending in (".parquet", ".csv") if csv else (".parquet",):
        _write_navigation(directory / f"navigation{ending}", result)
        _write_aided(directory / f"navigation_aided{ending}", result)
    return document


def _choices(
    run: "Run", unit: "UnitInputs", database: "TableStore | None"
) -> tuple[list["TableChoice"], tuple[str, ...]]:
    """The tables to fly with, active first, and what there is to say of them."""
    from infield.replay.free_inertial import TableChoice

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


def _write_navigation(path: Path, result: "ReplayResult") -> None:
    """The solutions at 1 Hz, one below the other; a file of an earlier replay goes where nothing
    was flown.
    """
    import numpy as np

    from ins.attitude import euler_from_dcm
    from ins.units import DEG
    from trajectories.runs.stream_files import write_columns

    flown = [t for t in result.tables if t.history is not None]
    if not flown:
        path.unlink(missing_ok=True)
        return
    parts = []
    for t in flown:
        h = t.history
        assert h is not None
        attitude = dict(zip(NAVIGATION, (angle / DEG for angle in euler_from_dcm(h.C_nb))))
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


def _write_aided(path: Path, result: "ReplayResult") -> None:
    """The aided solution with its sigmas at 1 Hz; an earlier file goes where there is none."""
    from infield.reports.documents.aided import aided_columns
    from trajectories.runs.stream_files import write_columns

    if result.aided is None or result.aided.history is None:
        path.unlink(missing_ok=True)
        return
    write_columns(path, aided_columns(result.aided))


def summary(document: dict[str, Any]) -> list[str]:
    """The result in a few lines for people."""
    lines = [f"{document['run_id']}: {document['verdict']}"]
    lines += [f"  because {reason}" for reason in document["reasons"]]
    lines += [f"  {note}" for note in document["notes"]]
    for t in document["tables"]:
        drift, predicted = t["parked"], t["predicted"]
        line = f"  {t['role']:9s}{t['origin']}: "
        if drift is None:
            lines.append(line + f"alignment {t['alignment']['verdict']}, no parked drift")
            continue
        expected = f" (predicted 1 sigma {predicted['sigma_nm_h']:.3f})" if predicted else ""
        lines.append(
            line + f"{drift['rate_nm_h']:.3f} NM/h{expected}, RMS rate {drift['rms_rate_nm_h']:.3f}"
            " NM/h, "
            f"{drift['end_speed_kt']:.2f} kt, class {drift['drift_class']}{_realign(t)}"
        )
        if (schuler := t["schuler"]) and not schuler["reason"]:
            lines.append(
                f"           Schuler period {schuler['period_min']:.1f} +-"
                f" {schuler['sigma_period_min']:.1f} min"
            )
    difference = document["difference"]
    if difference and difference["rate_nm_h"]:
        rate = difference["rate_nm_h"]
        lines.append(
            f"  previous to active: {rate['previous']:.3f} -> {rate['active']:.3f} NM/h, "
            f"heading {difference['heading_mrad']:+.2f} mrad"
        )
    return lines + _aided_lines(document["aided"])


def _realign(table: dict[str, Any]) -> str:
    if not table["realign"]:
        return ""
    return ", REALIGN" + (
        " by a stop that the IMU alone sees" if table["realign_at"] == ["imu"] else ""
    )


def _aided_lines(aided: dict[str, Any] | None) -> list[str]:
    """The aided solution in a few lines."""
    if aided is None:
        return []
    head = [
        f"  aided: {aided['verdict']}",
        *(f"    because {reason}" for reason in aided["reasons"]),
    ]
    head += [f"    {note}" for note in aided["notes"]]
    if "end" not in aided:
        return head
    start, end, nis, fixes = aided["start"], aided["end"], aided["consistency"], aided["fixes"]
    level = max(end["sigma_north_m"], end["sigma_east_m"])
    return head + [
        (
            f"    from {start['time_s']:.1f} s by {start['method']}; {fixes['used_position']} fixes"
            f" used, {fixes['rejected_position']} positions and {fixes['rejected_velocity']}"
            " velocities rejected"
        ),
        (
            f"    NIS position {nis['position']['nis_mean']:.2f}, velocity"
            f" {nis['velocity']['nis_mean']:.2f}; at the end 1 sigma {level:.3g} m level, roll"
            f" {end['sigma_roll_deg']:.3g}, pitch {end['sigma_pitch_deg']:.3g}, heading"
            f" {end['sigma_heading_deg']:.3g} deg"
        ),
    ]
