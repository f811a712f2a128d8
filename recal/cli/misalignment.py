"""`recal misalignment`: gyro misalignment from four azimuths."""

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
    Verbose,
    answer,
    finish,
    result_text,
    say,
)

if TYPE_CHECKING:
    from infield.misalignment.azimuth_biases import KnownAzimuths
    from infield.misalignment.study import AzimuthSettings, AzimuthStudy


Inputs = Annotated[
    list[Path],
    typer.Argument(
        help="Runs of one unit on four azimuths (one run may hold several stops), or one CSV table."
    ),
]
Headings = Annotated[
    str | None,
    typer.Option(
        "--heading-deg",
        help="Of the stops, such as 0,90,180,270; without them the gyros find the azimuths.",
    ),
]
NorthToWest = Annotated[
    str | None, typer.Option("--north-to-west-deg", help="The same, counted from north to west.")
]
SigmaAzimuth = Annotated[
    float, typer.Option("--sigma-azimuth-arcsec", help="Of each given heading by itself.")
]
SigmaNorth = Annotated[
    float,
    typer.Option("--sigma-north-arcsec", help="Of what all given headings share: their north."),
]
SigmaMounting = Annotated[
    float | None,
    typer.Option(
        "--sigma-mounting-arcsec",
        help="Of the unit's base against the turning axis: states accelerometer biases.",
    ),
]
MaxOff = Annotated[
    float, typer.Option("--max-off-deg", help="How far an azimuth may be off its place.")
]
Prior = Annotated[
    float, typer.Option("--prior-mrad", help="What a coupling may be before this, 1 sigma.")
]
Shortest = Annotated[float, typer.Option("--shortest-s", help="Stops below this are left out.")]
Latitude = Annotated[
    float | None, typer.Option("--lat-deg", help="Latitude of a table (runs have their own).")
]
Sigma = Annotated[
    float | None,
    typer.Option("--sigma-deg-h", help="Of the biases of a table without sigma columns."),
]
TwinPath = Annotated[Path | None, typer.Option("--twin", help="Noise model of the unit.")]
TwinOut = Annotated[
    Path | None, typer.Option("--twin-out", help="Write the twin with misalignment and sigma here.")
]


def command(
    inputs: Inputs,
    heading_deg: Headings = None,
    north_to_west_deg: NorthToWest = None,
    sigma_azimuth_arcsec: SigmaAzimuth = 5.0,
    sigma_north_arcsec: SigmaNorth = 30.0,
    sigma_mounting_arcsec: SigmaMounting = None,
    max_off_deg: MaxOff = 2.0,
    prior_mrad: Prior = 1.0,
    shortest_s: Shortest = 300.0,
    lat_deg: Latitude = None,
    sigma_deg_h: Sigma = None,
    store: StoreUrl = DEFAULT_STORE,
    twin: TwinPath = None,
    twin_out: TwinOut = None,
    output: OutputPath = None,
    as_json: JsonFlag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    seed: NoSeed = None,
) -> None:
    """Couplings of the level axes into each gyro, in arcsec with sigma, from stops on four azimuths
    90 deg apart.

    A table (CSV) has the columns heading_deg or north_to_west_deg, and bias_x_deg_h, sigma_x_deg_h
    and so on.

    Example: recal misalignment run-0 run-90 run-180 run-270 --heading-deg 0,90,180,270 --twin-out
    twin.json
    """
    from infield.misalignment.study import AzimuthSettings

    settings = AzimuthSettings(
        shortest_s=_size(shortest_s, "--shortest-s"),
        max_off_deg=_size(max_off_deg, "--max-off-deg"),
        prior_mrad=_size(prior_mrad, "--prior-mrad"),
        sigma_mounting_arcsec=_size(sigma_mounting_arcsec, "--sigma-mounting-arcsec"),
    )
    if is_table(inputs):
        if heading_deg or north_to_west_deg:
            raise typer.BadParameter(
                "a table has its azimuths in a column; --heading-deg and --north-to-west-deg are"
                " for runs"
            )
        study = study_of_table(
            inputs[0], lat_deg, _size(sigma_deg_h, "--sigma-deg-h"), twin, settings
        )
    else:
        sigmas = (
            _size(sigma_azimuth_arcsec, "--sigma-azimuth-arcsec"),
            _size(sigma_north_arcsec, "--sigma-north-arcsec"),
        )
        study = study_of_runs(
            inputs, known_azimuths(heading_deg, north_to_west_deg, sigmas), store, twin, settings
        )
    document = write_results(study, output, twin_out)
    answer(document, as_json=as_json, verbose=verbose)
    for line in summary(document):
        say(line, quiet=quiet)
    finish(document)


def is_table(inputs: list[Path]) -> bool:
    """One CSV file, not a run."""
    return len(inputs) == 1 and not inputs[0].is_dir() and inputs[0].suffix.lower() == ".csv"


def _size(value: Any, name: str) -> Any:
    """A number above zero, or None."""
    if value is not None and not 0 < value < float("inf"):
        raise typer.BadParameter(f"{name} = {value:g}, needed more than 0")
    return value


def known_azimuths(
    heading_deg: str | None, north_to_west_deg: str | None, sigmas_arcsec: tuple[float, float]
) -> "KnownAzimuths | None":
    """The given headings, None where there are none; typer.BadParameter where they are no list of
    numbers.
    """
    import numpy as np

    from infield.misalignment.azimuth_biases import KnownAzimuths
    from ins.units import ARCSEC, DEG

    text = heading_deg or north_to_west_deg
    if text is None:
        return None
    if heading_deg and north_to_west_deg:
        raise typer.BadParameter("--heading-deg and --north-to-west-deg are both given, needed one")
    try:
        angle = np.array([float(part) for part in text.split(",")])
    except ValueError:
        angle = np.array([np.nan])
    if not np.all(np.abs(angle) <= 360.0):
        raise typer.BadParameter(
            f"azimuths {text[:60]!r}, needed numbers within +-360 with commas between them"
        )
    heading = np.mod((angle if heading_deg else -angle) * DEG, 2 * np.pi)
    stop, north = (sigma * ARCSEC for sigma in sigmas_arcsec)
    return KnownAzimuths(heading_rad=heading, sigma_stop_rad=stop, sigma_north_rad=north)


def study_of_runs(
    paths: list[Path],
    known: "KnownAzimuths | None",
    store_url: str,
    twin: Path | None,
    settings: "AzimuthSettings",
) -> "AzimuthStudy":
    """The study of runs, with the table and the noise model of their unit."""
    from infield.misalignment.study import study_runs
    from infield.session.log import with_applied_table_undone
    from recal.service.unit_inputs import open_store, unit_inputs
    from trajectories.runs.directory import read_run

    database = open_store(store_url)
    undo = (lambda sha256: database.by_sha256(sha256).table) if database else None
    runs = [with_applied_table_undone(read_run(path), undo) for path in paths]
    unit = unit_inputs(runs[0], database, twin)
    return study_runs(runs, unit.table, unit.twin, known=known, settings=settings)


def study_of_table(
    path: Path,
    lat_deg: float | None,
    sigma_deg_h: float | None,
    twin: Path | None,
    settings: "AzimuthSettings",
) -> "AzimuthStudy":
    """The study of a table of biases; its latitude must be given, its unit is the twin's."""
    from infield.misalignment.azimuth_table import read_azimuth_table
    from infield.misalignment.study import study_table
    from ins.twin_file import default_twin, read_twin
    from ins.units import DEG

    if lat_deg is None or not abs(lat_deg) < 89.0:
        raise typer.BadParameter(
            "a table of biases needs --lat-deg, within +-89: the level Earth rate depends on it"
        )
    table = read_azimuth_table(path, sigma_deg_h=sigma_deg_h)
    unit = read_twin(twin) if twin else default_twin("fog")
    return study_table(
        table.heading_rad,
        table.bias_deg_h,
        table.sigma_deg_h,
        lat_rad=lat_deg * DEG,
        twin=unit,
        source=str(path),
        settings=settings,
    )


def write_results(
    study: "AzimuthStudy", output: Path | None, twin_out: Path | None
) -> dict[str, Any]:
    """misalignment.json, misalignment.html and, where asked for and measured, the twin; returns the
    document.
    """
    from infield.misalignment.reasons import MisalignmentVerdict
    from infield.misalignment.study import corrected_twin
    from infield.reports.documents.misalignment import misalignment_document
    from infield.reports.misalignment_page import render
    from ins.twin_file import twin_to_dict
    from ins.verdicts import plain
    from recal.service.output import output_directory, program_version, write_files

    found = misalignment_document(study, version=program_version())
    document = plain(found)
    directory = output_directory(output, "misalignment")
    files = {
        directory / "misalignment.json": result_text(document),
        directory / "misalignment.html": render(found),
    }
    if twin_out is not None and document["verdict"] == MisalignmentVerdict.MEASURED:
        files[twin_out] = result_text(twin_to_dict(corrected_twin(study)))
    write_files(files)
    return document


def summary(document: dict[str, Any]) -> list[str]:
    """The result in a few lines for people."""
    from ins.verdicts import Observability

    lines = [f"{document['imu_serial'] or document['source']}: {document['verdict']}"]
    lines += [f"  because {reason}" for reason in document["reasons"]]
    lines += [f"  {note}" for note in document["notes"]]
    for c in document["couplings"]:
        if c["verdict"] == Observability.NOT_OBSERVABLE:
            continue
        value = round(c["value_arcsec"], 1) + 0.0  # no -0.0
        lines.append(
            f"  {c['entry']:6s}{value:+9.1f} +- {c['sigma_arcsec']:.1f} arcsec ({c['verdict']})"
        )
    if document["redundancy"]:
        r = document["redundancy"]
        lines.append(
            f"  redundancy: chi-square {r['chi2']:.1f} of {r['dof']}, limit {r['limit_999']:.1f}"
        )
    lines += [
        f"  not observable: {row['what']}: {row['why']}" for row in document["not_observable"]
    ]
    return lines
