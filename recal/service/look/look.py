"""`look`: any log of any known format, recognised, converted, checked, drawn and judged."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ins.records import InputError, Run
from ins.twin_file import default_twin
from recal.service.align import align
from recal.service.check import Check, check
from recal.service.look.opened import LongestPart, Opened, opened_log
from recal.service.look.records import Fit, LogUse, LookReport, LookVerdict, NoiseNumber
from recal.service.look.series import series_of, shown_noise
from recal.service.look.uses import LookFindings, convert_command, uses_of
from recal.service.results.files import AnyPath, program_version
from recal.service.results.plots import figure_of
from recal.service.results.result import Result
from simreal.report.twin_page import allan_panels
from simreal.twin.fit.fit import fit_twin as fit_runs
from simreal.twin.fit.result import Parameter, TwinFit

if TYPE_CHECKING:
    from plotly.graph_objects import Figure
import shlex
from dataclasses import replace

from infield.reports.drawing import Panel, ShadedSpan
from recal.service.look.records import Use
from recal.service.results.files import write_text
from recal.service.results.overwrite import need_free_file
from recal.service.results.pages import render_page
from trajectories.readers.columns.starter_map import starter_map
from trajectories.readers.registry import UnknownLog as UnknownLog

LOOK_STEPS = 5  # that `told` is told of
OPTIONS = {  # of `recal convert`, by the key of run.json
    "imu_serial": "--serial",
    "gyro_technology": "--technology",
    "lat_deg": "--lat-deg",
    "sigma_lat_deg": "--sigma-lat-deg",
    "lon_deg": "--lon-deg",
    "height_m": "--height-m",
    "start_utc": "--start-utc",
    "tail": "--tail",
    "run_id": "--run-id",
    "accepted_accelerometer_scale": "--accepted-accelerometer-scale",
    "accepted_constant_temperature": "--accepted-constant-temperature",
    "any_attitude": "--any-attitude",
    "imu": "--imu",
    "format": "--format",
    "from_s": "--from-s",
    "to_s": "--to-s",
}
LOOK_VERDICTS = {  # word, look, symbol
    LookVerdict.USABLE: ("Usable", "good", "✔"),
    LookVerdict.REFUSED: ("Fit for nothing here", "none", "■"),
    LookVerdict.BAD_INPUT: ("Something is wrong with this log", "bad", "✖"),
}
FIT_BADGES = {Fit.YES: ("yes", "good"), Fit.PARTLY: ("partly", "fair"), Fit.NO: ("no", "none")}
USES = {
    Use.ALIGNMENT: "Alignment: attitude and heading",
    Use.NOISE: "Noise model of the unit",
    Use.TABLE: "Thermal table: recalibration",
    Use.REPLAY: "Replay: navigation",
    Use.DIAGNOSIS: "Diagnosis: simulator against log",
}
MEANS = (
    "A line joins means of many rows. The shading in its colour reaches from the least to the"
    " greatest of these rows."
)
CAPTIONS = {
    "temperature": "All thermometers that the log holds values of.",
    "rate": MEANS,
    "force": MEANS,
    "velocity": "North, east and down, as the receiver gives them.",
    "height": "Height above the ellipsoid. A log that gives heights above mean sea level is drawn"
    " with those: no geoid model is used.",
    "odometer": "Speed along the vehicle.",
}


@dataclass(frozen=True, repr=False, eq=False)
class Looked(Result[LookReport]):
    """What a log holds and what it can be used for: verdict `usable`, `refused` where it is fit for
    nothing, or `bad_input` where its check found an error.
    """

    @property
    def uses(self) -> tuple[LogUse, ...]:
        """Each use with its fit (`yes`, `partly`, `no`), why, and the command that does it."""
        return tuple(self.record.uses)

    def plot(self) -> "Figure":
        """Allan deviation of each channel at rest, and of the fitted noise model.

        Returns
        -------
        plotly.graph_objects.Figure
            A notebook shows it; `.write_html(path)` writes it.

        Raises
        ------
        InputError
            Where the log never rests.
        """
        if self.record.fitted is None:
            raise InputError(f"{self.record.run_id}: the log never rests, so no noise is drawn")
        return figure_of(allan_panels(self.record.fitted))

    def lines(self, *, verbose: bool = False) -> list[str]:
        """What the log is, what is wrong with it, and each use with its command."""
        document = self.record
        imu = document.holds.imu
        size = "" if imu is None else f", {imu.duration_s / 60.0:.1f} min at {imu.rate_hz:.4g} Hz"
        lines = [
            f"{document.run_id}: {document.verdict.replace('_', ' ')}",
            f"  {document.format}, {document.gyro_technology} unit {document.imu_serial}{size},"
            f" {document.rest_s / 60.0:.1f} min at rest",
        ]
        for one in document.assumed:
            value = one.value if isinstance(one.value, str) else f"{one.value:g}"
            value += f" +- {one.sigma:.2g}" if one.sigma else ""
            lines.append(f"  assumed: {one.key} {value} ({one.text}); give it with {one.option}")
        lines += [f"  note: {note}" for note in document.notes]
        lines += [f"  {p.level}: {p.text}" for p in document.problems]
        for use in document.uses:
            lines.append(f"  {use.use:10s}{use.fit:7s} {use.why}")
        commands = [document.convert, *(use.command for use in document.uses)]
        lines += ["  next:", *(f"    {command}" for command in commands if command)]
        return lines


def look(
    log: AnyPath,
    *,
    map_file: AnyPath | None = None,
    gnss: AnyPath | None = None,
    header: Mapping[str, str | float | None] | None = None,
    options: Mapping[str, str | float | None] | None = None,
    told: Callable[[str], None] = lambda words: None,
) -> Looked:
    """Look at a log of any known format, or at a run directory.

    Parameters
    ----------
    log : str or path
        A flight log, or a run directory.
    map_file : str or path, optional
        TOML map of a table: columns, units, axes, rate.
    gnss : str or path, optional
        Fixes that are in a file of their own.
    header, options : mapping, optional
        As of `convert`. What neither they nor the log say is taken for granted and named.
    told : callable
        Told what is being done.

    Returns
    -------
    Looked
        Verdict, `.uses`, what the log holds, its noise at rest; `.to_html(path)` draws it. Nothing
        is kept of the run that it is converted to.

    Raises
    ------
    InputError
        Where the log's format is not known or it cannot be read, and why.

    Examples
    --------
    >>> import recal
    >>> recal.look("nothing.bin")
    Traceback (most recent call last):
        ...
    ins.records.InputError: nothing.bin: no such file
    """
    path = Path(log)
    given_header, given_options = dict(header or {}), dict(options or {})
    told("reading the log")
    opening = opened_log(
        path, map_file=map_file, gnss=gnss, header=given_header, options=given_options
    )
    with opening as opened:
        told("checking the run")
        checked = check(opened.folder)
        told("aligning")
        aligned = align(opened.run).record
        told("fitting the noise")
        fitted, noise_notes = shown_noise(_noise(opened.run))
        is_run = opened.folder == path
        run_path = str(path) if is_run else f"{path.name.split('.')[0]}-run"
        judged = LookFindings(run=opened.run, run_path=run_path, aligned=aligned, fitted=fitted)
        uses = uses_of(judged)
        files = {"--map": map_file, "--gnss": gnss}
        given: dict[str, str | float | None]
        given = {name: None if file is None else str(file) for name, file in files.items()}
        given |= {OPTIONS[k]: v for k, v in {**given_header, **given_options}.items()}
        cut = opened.stretch
        if cut is not None:
            given |= {"--from-s": f"{cut.from_s:.3f}", "--to-s": f"{cut.to_s:.3f}"}
        told("drawing the page")
        document = LookReport(
            verdict=_verdict(checked, uses),
            reasons=[p.text for p in checked.problems if p.level != "warning"],
            version=program_version(),
            log=str(path),
            format=opened.format,
            run_id=opened.run.header.run_id,
            imu_serial=opened.run.header.imu_serial,
            gyro_technology=opened.run.header.gyro_technology,
            start_utc=_start(opened),
            assumed=opened.assumed,
            holds=checked.record.holds,
            problems=checked.problems,
            notes=[*_gap_note(opened.stretch), *noise_notes, *opened.notes],
            repaired=checked.record.repaired,
            phases=aligned.phases or (),
            rest_s=judged.rest_s,
            uses=uses,
            noise=[NoiseNumber(**vars(p)) for p in _told(fitted)],
            convert="" if is_run else convert_command(str(path), run_path, opened.assumed, given),
            series=series_of(opened.run),
            fitted=fitted,
        )
    return Looked(document, page=lambda: look_html(document))


def _noise(run: Run) -> TwinFit | None:
    """The noise at rest, None where the run never rests."""
    found = fit_runs([run], default_twin(run.header.gyro_technology))
    return found if found.parameters else None


def _verdict(checked: Check, uses: Sequence[LogUse]) -> LookVerdict:
    if not checked.ok:
        return LookVerdict.BAD_INPUT
    usable = any(use.fit is not Fit.NO for use in uses)
    return LookVerdict.USABLE if usable else LookVerdict.REFUSED


def _start(opened: Opened) -> str | None:
    if any(one.key == "start_utc" for one in opened.assumed):
        return None
    return opened.run.header.start_utc


def _gap_note(cut: LongestPart | None) -> list[str]:
    """That only one stretch of the log was looked at."""
    if cut is None:
        return []
    return [
        f"the log has gaps of more than a second: this is the longest of {cut.of} stretches,"
        f" {cut.from_s:.3f} to {cut.to_s:.3f} s by the log's own clock; recal convert --split makes"
        " a run of each"
    ]


def _told(fitted: TwinFit | None) -> list[Parameter]:
    """The numbers of a noise model that the log tells."""
    return [] if fitted is None else [p for p in fitted.parameters if p.identified]


def look_html(document: LookReport) -> str:
    """The page of a look."""
    fitted = document.fitted
    return render_page(
        "look.html.j2",
        "recal.service.look",
        d=document,
        verdict=LOOK_VERDICTS[document.verdict],
        fits=FIT_BADGES,
        uses=USES,
        series=[
            (panel.label, _shaded(panel, document), CAPTIONS[name])
            for name, panel in document.series.items()
        ],
        allan=None if fitted is None else allan_panels(fitted),
        noise=[(p.words, p.size_words) for p in _told(fitted)],
    )


def _shaded(panel: Panel, document: LookReport) -> Panel:
    """With every second phase shaded."""
    spans = [ShadedSpan(phase.start_s, phase.end_s) for phase in document.phases[1::2]]
    return replace(panel, spans=spans)


def write_starter(log: Path, output: Path, unknown: UnknownLog, *, force: bool = False) -> None:
    """Write the map of a table.

    Parameters
    ----------
    log : Path
        The table.
    output : Path
        The map; never written over without `force`, for somebody may have completed it.
    unknown : UnknownLog
        What the readers said of the log.

    Raises
    ------
    InputError
        Always: it says what was guessed and why, what is left to fill in, and the next command;
        where no map could be begun, nothing and the caller goes on.
    """
    found = starter_map(log)
    if found is None:
        return
    need_free_file(output, None, force=force)
    write_text(output, found.text)
    run = shlex.quote(f"{log.name.split('.')[0]}-run")
    command = f"recal convert {shlex.quote(str(log))} --map {shlex.quote(str(output))} -o {run}"
    raise InputError(
        f"{log}: a table of unknown columns; {output} is a column map to begin with",
        [
            *(f"  {key:12s} {words}" for key, words in found.guesses),
            f'  to be filled in where it says "?": {", ".join(found.missing)}',
            f"  next: {command}",
        ],
    ) from unknown
