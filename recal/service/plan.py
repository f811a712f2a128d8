"""`plan`: which recordings would separate rival effects, and how large an effect must be to be
seen.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

from ins.records import InputError, Run, Site, TwinModel
from ins.twin_file import default_twin
from ins.units import DEG
from recal.service.inputs.records import AnyRun, runs_of
from recal.service.inputs.twin_table import TwinTable, twin_and_table
from recal.service.results.files import AnyPath, program_version
from recal.service.results.result import Result, write_report
from simreal.evidence.run_view import RunView, view_run
from simreal.plan.flights import check_technology, plan_flights
from simreal.plan.pairs import CLASSICAL, read_pair
from simreal.plan.recordings import candidates
from simreal.plan.study import PlanSettings, study
from simreal.report.plan_document import PlanReport, plan_document, summary
from simreal.report.plan_page import plan_html

DEFAULT_LAT_DEG = 45.0


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class Planned(Result[PlanReport]):
    """Recordings that would separate rival effects."""

    def lines(self, *, verbose: bool = False) -> list[str]:
        """Pair by pair what to record, and what would be seen."""
        return summary(self.record)

    def write(self, output: AnyPath | None = None) -> Path:
        """Write plan.json and plan.html to a directory (else `recal-plan`); returns it."""
        return write_report(self, output or "recal-plan", "plan")


@dataclass(frozen=True, kw_only=True)
class PlanRequest:
    """What is to be separated, and what there is to do it with.

    Parameters
    ----------
    twin : path, optional
        Twin file with the noise model of the unit; else that of its technology.
    technology : {'rlg', 'fog', 'mems'}
        Technology of the gyros, where there is neither twin nor run.
    separate : sequence of str
        Two effects to tell apart; A@gyro_y names the channel. May be repeated. Default: the pairs
        that are usually confused.
    without : sequence of {'gnss', 'odometer', 'taxi', 'gradient'}
        What a recording here cannot have. May be repeated.
    lat_deg : float in [-85, 85]
        Latitude [deg]. Default: that of the runs, else 45.
    most : int in [1, 12]
        How many new recordings at most.
    seed : int
        Of the random generator.
    flights : bool
        Also which flight with a receiver would bring which gyro to which sigma.
    """

    twin: AnyPath | None = None
    technology: str = "rlg"
    separate: Sequence[str] = ()
    without: Sequence[str] = ()
    lat_deg: float | None = None
    most: int = 6
    seed: int = 0
    flights: bool = False


def plan(
    runs: AnyRun | Sequence[AnyRun] = (),
    request: PlanRequest | None = None,
    *,
    told: Callable[[str], None] = lambda words: None,
) -> Planned:
    """Which recordings would separate rival effects, and from which size each effect is seen.

    Parameters
    ----------
    runs : Run or path, or several
        Recordings at hand; none: plan from nothing.
    request : PlanRequest, optional
        What is to be separated, and what there is to do it with.
    told : callable
        Told what is being done.

    Returns
    -------
    Planned
        For each pair the recordings that separate it, and the smallest size seen.

    Raises
    ------
    InputError
        Where a pair names no effect, or twin and runs are of different units.

    Examples
    --------
    >>> import recal
    >>> recal.plan(request=recal.PlanRequest(separate=["nothing,gyro_thermal_linear"]))
    Traceback (most recent call last):
        ...
    ins.records.InputError: ...
    """
    wanted = request or PlanRequest()
    pairs = [read_pair(text) for text in wanted.separate or CLASSICAL]
    read = runs_of(runs) if isinstance(runs, Run | str | PathLike) or runs else []
    twin, beside = _unit(wanted, read)
    if wanted.flights:
        check_technology(twin)
    lat_deg = wanted.lat_deg
    if lat_deg is None:
        lat_deg = read[0].header.site.lat_rad / DEG if read else DEFAULT_LAT_DEG
    height_m = read[0].header.site.height_m if read else 0.0
    site = Site(lat_rad=lat_deg * DEG, lon_rad=0.0, height_m=height_m)
    found = study(
        pairs,
        twin,
        beside.table,
        site,
        PlanSettings(seed=wanted.seed, without=tuple(wanted.without), most=wanted.most),
        given=_views(read, twin, beside),
        told=told,
    )
    record = plan_document(
        found, lat_deg=lat_deg, without=wanted.without, version=program_version()
    )
    if wanted.flights:
        promised = plan_flights(twin, beside.table, site, wanted.seed, told)
        record = replace(record, flights=promised)
    return Planned(record, page=lambda: plan_html(record))


def plan_steps(request: PlanRequest) -> int:
    """How many steps `plan` tells of: a recording each, the choice, the comparison."""
    return len(candidates(tuple(request.without))) + 2


def _unit(request: PlanRequest, runs: list[Run]) -> tuple[TwinModel, TwinTable]:
    """The twin with its table, read beside the twin file."""
    if request.twin is None:
        technology = runs[0].header.gyro_technology if runs else request.technology
        return default_twin(technology), TwinTable()
    return twin_and_table(request.twin, runs)


def _views(runs: list[Run], twin: TwinModel, beside: TwinTable) -> list[RunView]:
    views = []
    for k, run in enumerate(runs):
        view = view_run(run, k, beside.table, twin, table_sha256=beside.sha256)
        if isinstance(view, str):
            raise InputError(f"run {run.header.run_id}: {view}")
        views.append(view)
    return views
