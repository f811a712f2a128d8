"""`recal misalignment`: gyro misalignment from four azimuths."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recal.cli.console import Shown
from recal.cli.parameters.verbs import made_from
from recal.cli.terminal.help import INPUT

if TYPE_CHECKING:
    from recal.service.misalignment import KnownAzimuths


@made_from(heading_deg="DEG,DEG,...", north_to_west_deg="DEG,DEG,...", twin_out="FILE")
def misalignment(
    shown: Shown,
    inputs: list[Path],
    /,
    heading_deg: str | None = None,
    north_to_west_deg: str | None = None,
    sigma_azimuth_arcsec: float = 5.0,
    sigma_heading_deg: float | None = None,
    sigma_north_arcsec: float | None = None,
    sigma_mounting_arcsec: float | None = None,
    max_off_deg: float = 2.0,
    prior_mrad: float = 1.0,
    shortest_s: float = 300.0,
    lat_deg: Annotated[
        float | None,
        typer.Option(
            rich_help_panel=INPUT,
            help="Latitude of a CSV table [deg]; runs have their own. Default: none.",
        ),
    ] = None,
    sigma_deg_h: float | None = None,
    *,
    store,
    twin,
    twin_out: Path | None = None,
    output,
    force,
) -> None:
    """Measure how much of each level axis a gyro feels, in arcsec with sigma, from stops on four
    azimuths 90 deg apart.

    A table (CSV) has the columns heading_deg or north_to_west_deg, and bias_x_deg_h, sigma_x_deg_h
    and so on.

    Example: recal misalignment run-0 run-90 run-180 run-270 --heading-deg 0,90,180,270 --twin-out
    twin.json

    Parameters
    ----------
    inputs
        Runs of one unit on four azimuths (one run may hold several stops), or one CSV table.
    heading_deg
        Headings of the stops, such as 0,90,180,270. Default: the gyros find the azimuths.
    north_to_west_deg
        Headings of the stops, counted from north to west. Default: as --heading-deg.
    sigma_azimuth_arcsec
        1 sigma of each given heading by itself [arcsec].
    sigma_heading_deg
        1 sigma of the error that all given headings share, those of a table too [deg]; 0 only
        where north is known without error. Default: 0.1.
    sigma_north_arcsec
        The same in seconds of arc [arcsec]; give one of the two.
    sigma_mounting_arcsec
        1 sigma of the angle between the unit's base and the turning axis [arcsec]. Where it is
        given, the result states accelerometer biases. Default: not given.
    max_off_deg
        How far a stop may be off its quarter turn [deg].
    prior_mrad
        1 sigma of what a coupling may be before it is measured [mrad].
    shortest_s
        Shorter stops are left out [s].
    sigma_deg_h
        1 sigma of the biases of a CSV table without sigma columns [deg/h].
    twin_out
        Also write the twin with the misalignment and its sigma to this file. Default: not written.
    """
    from recal.service.misalignment import AzimuthSettings, misalignment_of_table
    from recal.service.misalignment import misalignment as measured
    from recal.service.results.overwrite import need_free_file

    folder = shown.folder(output, "recal.misalignment/1", "misalignment.html", force=force)
    if twin_out is not None:
        need_free_file(twin_out, None, force=force)
    settings = AzimuthSettings(
        shortest_s=_size(shortest_s, "--shortest-s"),
        max_off_deg=_size(max_off_deg, "--max-off-deg"),
        prior_mrad=_size(prior_mrad, "--prior-mrad"),
        sigma_mounting_arcsec=_size(sigma_mounting_arcsec, "--sigma-mounting-arcsec"),
        sigma_heading_deg=common_sigma_deg(sigma_heading_deg, sigma_north_arcsec),
    )
    one = inputs[0]
    if len(inputs) == 1 and not one.is_dir() and one.suffix.lower() == ".csv":
        if heading_deg or north_to_west_deg:
            raise typer.BadParameter(
                "a table has its azimuths in a column; --heading-deg and --north-to-west-deg are"
                " for runs"
            )
        if lat_deg is None or not abs(lat_deg) < 89.0:
            raise typer.BadParameter(
                "a table of biases needs --lat-deg, within +-89: the level Earth rate depends on it"
            )
        sigma = _size(sigma_deg_h, "--sigma-deg-h")
        found = misalignment_of_table(
            one, lat_deg=lat_deg, sigma_deg_h=sigma, twin=twin, settings=settings
        )
    else:
        stop_arcsec = _size(sigma_azimuth_arcsec, "--sigma-azimuth-arcsec")
        known = given_azimuths(
            heading_deg,
            north_to_west_deg,
            sigma_stop_arcsec=stop_arcsec,
            sigma_heading_deg=settings.sigma_heading_deg,
        )
        with shown.progress("finding the stops", len(inputs) + 1) as told:
            found = measured(inputs, twin, known=known, settings=settings, store=store, told=told)
    written = found.write(folder, twin_out=twin_out)
    shown.end(found, written / "misalignment.html")


def _size(value: Any, name: str) -> Any:
    """A number above zero, or None."""
    if value is not None and not 0 < value < float("inf"):
        raise typer.BadParameter(f"{name} = {value:g}, needed more than 0")
    return value


def common_sigma_deg(sigma_heading_deg: float | None, sigma_north_arcsec: float | None) -> float:
    """1 sigma of the error that all given headings share [deg]; typer.BadParameter where both
    options are given, or one is no size.
    """
    from recal.service.misalignment import AzimuthSettings

    if sigma_heading_deg is not None and sigma_north_arcsec is not None:
        raise typer.BadParameter(
            "--sigma-heading-deg and --sigma-north-arcsec are both given, needed one"
        )
    if sigma_north_arcsec is not None:
        return float(_size(sigma_north_arcsec, "--sigma-north-arcsec")) / 3600.0
    given = AzimuthSettings.sigma_heading_deg if sigma_heading_deg is None else sigma_heading_deg
    if not 0 <= given <= 180.0:
        raise typer.BadParameter(f"--sigma-heading-deg = {given:g}, needed 0 to 180")
    return given


def given_azimuths(
    heading_deg: str | None,
    north_to_west_deg: str | None,
    *,
    sigma_stop_arcsec: float,
    sigma_heading_deg: float,
) -> "KnownAzimuths | None":
    """The given headings, None where there are none; typer.BadParameter where they are no list of
    numbers.
    """
    from recal.service.misalignment import known_azimuths

    text = heading_deg or north_to_west_deg
    if text is None:
        return None
    if heading_deg and north_to_west_deg:
        raise typer.BadParameter("--heading-deg and --north-to-west-deg are both given, needed one")
    try:
        angles = [float(part) for part in text.split(",")]
    except ValueError:
        angles = [float("nan")]
    if not all(abs(angle) <= 360.0 for angle in angles):
        raise typer.BadParameter(
            f"azimuths {text[:60]!r}, needed numbers within +-360 with commas between them"
        )
    headings = angles if heading_deg else [-angle for angle in angles]
    return known_azimuths(
        headings, sigma_stop_arcsec=sigma_stop_arcsec, sigma_heading_deg=sigma_heading_deg
    )
