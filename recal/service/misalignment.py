"""`misalignment`: couplings of the level axes into each gyro, from stops on four azimuths."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from infield.misalignment.azimuth_biases import KnownAzimuths
from infield.misalignment.azimuth_table import read_azimuth_table
from infield.misalignment.reasons import MisalignmentVerdict
from infield.misalignment.study import (
    AzimuthSettings,
    AzimuthStudy,
    corrected_twin,
    study_runs,
    study_table,
)
from infield.reports.documents.misalignment import MisalignmentDocument, misalignment_document
from infield.reports.misalignment_page import render
from infield.session.log import with_applied_table_undone
from infield.store.table_store import TableStore
from ins.documents import to_json
from ins.records import InputError, TwinModel
from ins.twin_file import default_twin, twin_to_dict
from ins.units import ARCSEC, DEG
from ins.verdicts import Observability, measured_words
from recal.service.inputs.records import AnyRun, AnyTwin, runs_of, twin_of
from recal.service.inputs.unit_inputs import opened, unit_inputs
from recal.service.results.files import AnyPath, program_version
from recal.service.results.result import Result, write_report

__all__ = [
    "AzimuthSettings",
    "KnownAzimuths",
    "Misaligned",
    "known_azimuths",
    "misalignment",
    "misalignment_of_table",
]


@dataclass(frozen=True)
class Coupling:
    """What gyro `entry[0]` reads of the rate about `entry[1]` [arcsec], with one sigma."""

    entry: str
    value_arcsec: float | None
    sigma_arcsec: float | None
    verdict: str


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class Misaligned(Result[MisalignmentDocument]):
    """Measured couplings.

    Parameters
    ----------
    study : AzimuthStudy
        What the estimator found.
    """

    study: AzimuthStudy

    @property
    def couplings(self) -> tuple[Coupling, ...]:
        """Those of the level axes into each gyro."""
        return tuple(
            Coupling(c.entry, c.value_arcsec, c.sigma_arcsec, c.verdict)
            for c in self.record.couplings
        )

    @property
    def twin(self) -> TwinModel | None:
        """The unit's twin with the couplings and their sigma; None where nothing was measured."""
        return corrected_twin(self.study) if self.verdict == MisalignmentVerdict.MEASURED else None

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Verdict, couplings with one sigma, the redundant equations."""
        return summary(self.record)

    def write(self, output: AnyPath | None = None, *, twin_out: AnyPath | None = None) -> Path:
        """Write misalignment.json and misalignment.html to a directory (else
        `recal-misalignment`), and where measured the twin to `twin_out`; returns the directory.
        """
        twin = {}
        if twin_out is not None and self.twin is not None:
            twin = {str(Path(twin_out).absolute()): to_json(twin_to_dict(self.twin))}
        return write_report(self, output or "recal-misalignment", "misalignment", twin)


def misalignment(
    runs: AnyRun | Sequence[AnyRun],
    twin: AnyTwin | None = None,
    *,
    known: KnownAzimuths | None = None,
    settings: AzimuthSettings | None = None,
    store: TableStore | str | None = None,
    told: Callable[[str], None] = lambda words: None,
) -> Misaligned:
    """Couplings of the level axes into each gyro, from stops on four azimuths 90 deg apart.

    Parameters
    ----------
    runs : Run or path, or several
        Runs of one unit; one may hold several stops.
    twin : TwinModel or path, optional
        Noise model; else the store's, else the defaults of the technology.
    known : KnownAzimuths, optional
        Headings [rad] of the stops with sigma; without them the gyros find the azimuths.
    settings : AzimuthSettings, optional
        Shortest stop [s], largest departure [deg], prior [mrad].
    store : str or TableStore, optional
        Looked in for table and noise model.
    told : callable
        Told what is being done: a step for each run, and one for all.

    Returns
    -------
    Misaligned
        Couplings [arcsec] with one sigma; `.twin` has them in.

    Raises
    ------
    InputError
        Where an input cannot be read, or the inputs are of different units.

    Examples
    --------
    >>> import recal
    >>> recal.misalignment("nowhere")
    Traceback (most recent call last):
        ...
    ins.records.InputError: nowhere: no such run directory
    """
    database = opened(store)
    undo = (lambda sha256: database.by_sha256(sha256).table) if database else None
    read = [with_applied_table_undone(run, undo) for run in runs_of(runs)]
    unit = unit_inputs(read[0], database, twin)
    study = study_runs(
        read, unit.table, unit.twin, known=known, settings=settings or AzimuthSettings(), told=told
    )
    return _made(study)


def misalignment_of_table(
    path: AnyPath,
    *,
    lat_deg: float,
    sigma_deg_h: float | None = None,
    twin: AnyTwin | None = None,
    settings: AzimuthSettings | None = None,
) -> Misaligned:
    """The same from a table of biases at given azimuths (CSV); its unit is the twin's.

    Parameters
    ----------
    path : str or path
        Columns heading_deg or north_to_west_deg, bias_x_deg_h, sigma_x_deg_h and so on.
    lat_deg : float
        Latitude of the table, within +-89.
    sigma_deg_h : float, optional
        Of the biases of a table without sigma columns.
    twin : TwinModel or path, optional
        Noise model of the unit.
    settings : AzimuthSettings, optional
        As for `misalignment`.
    """
    if not abs(lat_deg) < 89.0:
        raise InputError(f"lat_deg = {lat_deg:g}, needed within +-89")
    table = read_azimuth_table(Path(path), sigma_deg_h=sigma_deg_h)
    study = study_table(
        table.heading_rad,
        table.bias_deg_h,
        table.sigma_deg_h,
        lat_rad=lat_deg * DEG,
        twin=twin_of(twin) if twin is not None else default_twin("fog"),
        source=str(path),
        settings=settings or AzimuthSettings(),
    )
    return _made(study)


def known_azimuths(
    headings_deg: Sequence[float],
    *,
    sigma_stop_arcsec: float = 5.0,
    sigma_heading_deg: float = AzimuthSettings.sigma_heading_deg,
) -> KnownAzimuths:
    """Headings that were given.

    Parameters
    ----------
    headings_deg : sequence of float
        One for each stop, in the order of the runs [deg].
    sigma_stop_arcsec : float
        1 sigma of each by itself [arcsec].
    sigma_heading_deg : float
        1 sigma of the error that all share [deg].
    """
    return KnownAzimuths(
        heading_rad=np.mod(np.array(headings_deg) * DEG, 2 * np.pi),
        sigma_stop_rad=sigma_stop_arcsec * ARCSEC,
        sigma_north_rad=sigma_heading_deg * DEG,
    )


def _made(study: AzimuthStudy) -> Misaligned:
    found = misalignment_document(study, version=program_version())
    return Misaligned(found, page=lambda: render(found), study=study)


def summary(document: MisalignmentDocument) -> list[str]:
    """The result in a few lines for people."""
    lines = [f"{document.imu_serial or document.source}: {document.verdict}"]
    lines += [f"  because {reason}" for reason in document.reasons]
    lines += [f"  {note}" for note in document.notes]
    for c in document.couplings:
        if c.verdict == Observability.NOT_OBSERVABLE or c.value_arcsec is None:
            continue
        value = round(c.value_arcsec, 1) + 0.0  # no -0.0
        said = measured_words(c.verdict, c.value_arcsec, c.sigma_arcsec)
        lines.append(f"  {c.entry:6s}{value:+9.1f} +- {c.sigma_arcsec:.1f} arcsec ({said})")
    if r := document.redundancy:
        lines.append(f"  redundancy: chi-square {r.chi2:.1f} of {r.dof}, limit {r.limit_999:.1f}")
    lines += [f"  not observable: {row.what}: {row.why}" for row in document.not_observable]
    return lines
