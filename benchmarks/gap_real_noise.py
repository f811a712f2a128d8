"""Effects laid over real recordings: found, and named by what is really logged?

Each log of the data that rests long enough gets a twin of its own noise (`recal twin fit`), with
what the log shows as it is taken in (an implant must not be judged by what was there before: of the
first ones without that, half rested on the log as it is). Then an
effect is laid over a gyro, of forms that the catalogue does not use (a step that takes seconds, a
drift that bends, a triangle wave, uniform noise), 5 to 40 sigma of that log. Every log is given a
placebo. Of a temperature: that of the copter's third IMU stretched over the log, backwards, as it
ran, or with a different curve on each axis (backwards, as it ran, and shifted by half). Of a
heading: the log is cut into starts of equal length, and each is told a heading drawn by lot, by
which effects of the magnetic field, of Earth rate and of the site would show. A named cause that
rests on the placebo with a probability above a half is a hit of the placebo; it is said which of
them stand alone, without any rival.

`--halves`: what is found on the first half of an implanted log is written into a twin file, and
that file is judged by the second half, which nothing was fitted to: nats of its gap before and
after.
"""

import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.study import ROOT, Record, Work, table
from ins.attitude import dcm_from_euler
from ins.documents import to_json
from ins.earth import omega_ie_n
from ins.json_file import read_toml
from ins.records import Run, TemperatureLog, TwinModel
from ins.twin_file import read_twin
from recal.service.twin.fit import fit_twin
from simreal.declared.twin_effects import parse_effects, twin_extra_noise, twin_traces
from simreal.effects.telemetry import Telemetry
from simreal.evidence import run_view
from simreal.evidence.run_view import RunView, view_run
from simreal.evidence.whitened import Evidence
from simreal.inference import diagnosis
from simreal.inference.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from simreal.inference.locate import cells_of, measure_cells
from simreal.inference.noise_hypotheses import Squares
from simreal.twin.write_back import fitted_items, twin_with_causes
from tests.cut import cut_run
from trajectories.readers.conversion import convert_log

LOGS = ("ln100", "calgary", "apm", "copter-imu1", "copter-imu2", "copter-imu3")
PLACEBO = "copter-imu3"
SIZES = (5.0, 10.0, 20.0, 40.0)
REPLICATES = 100
CONFIDENT = 0.9
HEADINGS = "headings shuffled"
KINDS = ("backwards", "as it ran", "axes swapped", HEADINGS)
THERMAL = ("gyro_thermal", "unknown_function_of_temperature", "accel_thermal", "gyro_noise_thermal")
# what a heading tells from a bias of a start
OF_HEADING = (
    "gyro_magnetic_sensitivity",
    "gyro_misalignment",
    "gyro_scale_factor",
    "site_latitude_error",
    "vertical_deflection",
)
SHORTEST_START_S = 70.0  # of a log cut into starts: a rest of a minute, with ten seconds to spare
MOST_STARTS = 4
Form = Callable[[NDArray, np.random.Generator], NDArray]


def _late_step(x: NDArray, rng: np.random.Generator) -> NDArray:
    return 0.5 + 0.5 * np.tanh((x - rng.uniform(0.3, 0.7)) / 0.01)


def _bent_drift(x: NDArray, rng: np.random.Generator) -> NDArray:
    return np.asarray(x ** rng.uniform(1.2, 1.6))


def _triangle(x: NDArray, rng: np.random.Generator) -> NDArray:
    return np.abs(2.0 * ((x * rng.uniform(3.0, 6.0)) % 1.0) - 1.0) - 0.5


def _uniform(x: NDArray, rng: np.random.Generator) -> NDArray:
    return rng.uniform(-1.0, 1.0, x.size)


# a form, and the names that are right for it (the generic answer of its kind among them)
FORMS: dict[str, tuple[Form, tuple[str, ...]]] = {
    "late step": (_late_step, ("gyro_bias_step", "gyro_mode_hop", "unknown_function_of_time")),
    "bent drift": (
        _bent_drift,
        ("gyro_rate_ramp", "gyro_warmup_transient", "unknown_function_of_time", "slow_variation"),
    ),
    "triangle wave": (_triangle, ("unknown_function_of_time", "slow_variation", "gyro_mode_hop")),
    "uniform noise": (
        _uniform,
        ("gyro_angle_random_walk", "gyro_quantization", "timestamp_jitter", "gyro_noise_of_time"),
    ),
}


@dataclass(frozen=True)
class Log:
    """A real log with its placebo, its twin, what is found on it as it is, and what still is with
    all of that in the twin: an implant is judged by what it adds to this.

    rest : where it rests [s of its clock]. starts : into how many it is cut.
    """

    name: str
    placebo: str
    run: Run
    twin: TwinModel
    rest: tuple[float, float]
    starts: int = 1
    causes: tuple[str, ...] = ()
    left: frozenset[tuple[str, str]] = frozenset()

    def runs(self, whole: Run) -> list[Run]:
        """The log, or an implanted one, as what is diagnosed."""
        if self.starts == 1:
            return [whole]
        edges = np.linspace(*self.rest, self.starts + 1)
        return [cut_run(whole, float(a), float(b)) for a, b in pairwise(edges)]

    def diagnosed(self, whole: Run, twin: TwinModel) -> Diagnosis:
        told = diagnosis.view_run
        if self.placebo == HEADINGS:
            diagnosis.view_run = _with_drawn_heading
        try:
            return diagnose(self.runs(whole), twin, None, DiagnosisSettings(replicates=REPLICATES))
        finally:
            diagnosis.view_run = told

    @property
    def tied(self) -> tuple[str, ...]:
        """How the names begin that rest on the placebo."""
        return OF_HEADING if self.placebo == HEADINGS else THERMAL


@lru_cache(maxsize=1)
def converted(data: str) -> dict[str, Run]:
    """The logs as runs, by their names."""
    folder = Path(data)
    ln100, calgary = (
        read_toml(ROOT / "examples" / "maps" / f"{name}.toml")
        for name in ("x_LN100_up", "calgary_project_data")
    )
    runs = {
        "ln100": convert_log(folder / "x_LN100_up.ins", ln100, {}).run,
        "apm": convert_log(folder / "apm_fixedwing_TestLog2.mat", {}, {}).run,
        "calgary": convert_log(folder / "calgary_project_data.BIN", calgary, {}).run,
    }
    for k in (1, 2, 3):  # a gap of 2 s follows
        options = {"imu": k, "to_s": 73.0}
        runs[f"copter-imu{k}"] = convert_log(folder / "ardupilot_log171.bin", options, {}).run
    return runs


@lru_cache(maxsize=len(LOGS) * len(KINDS))
def prepared(data: str, name: str, kind: str) -> Log | None:
    """A log under a twin of its own; None where it does not rest for a fit of its noise."""
    runs = converted(data)
    placebo = runs[PLACEBO].temperature
    twin = fit_twin(runs[name]).twin
    view = "" if twin is None else view_run(runs[name], 0, None, twin)
    if twin is None or placebo is None or isinstance(view, str):
        return None
    rest = view.start_s, view.end_s
    run, starts = runs[name], 1
    if kind == HEADINGS:
        starts = min(MOST_STARTS, int((rest[1] - rest[0]) // SHORTEST_START_S))
    else:
        run = with_placebo(run, placebo, kind)
    return _prepared(Log(name, kind, run, twin, rest, starts))


def _prepared(log: Log) -> Log:
    """The log with what it shows as it is in its twin."""
    found = log.diagnosed(log.run, log.twin)
    names = [run.header.run_id for run in log.runs(log.run)]
    again = _twin_with(log.twin, found, names)
    said = tuple(f"{c.effect} on {c.target} {c.probability:.2f}" for c in found.causes)
    left = frozenset((c.effect, c.target) for c in log.diagnosed(log.run, again).causes)
    return replace(log, twin=again, causes=said, left=left)


def _twin_with(twin: TwinModel, found: Diagnosis, run_ids: Sequence[str]) -> TwinModel:
    """With all that was fitted to a recording, also what other data do not bear: it is to describe
    this recording alone.
    """
    more = [item for cause in found.causes for item in fitted_items(cause, run_ids)]
    return replace(twin, effects=(*twin.effects, *json.loads(json.dumps(more))))


def with_placebo(run: Run, placebo: TemperatureLog, kind: str) -> Run:
    """The run with temperatures that have nothing to do with it."""
    start, end = run.imu.start_s, run.imu.end_s
    time_s = np.arange(np.ceil(start), np.floor(end), 1.0)
    x = (time_s - time_s[0]) / max(time_s[-1] - time_s[0], 1.0)
    own = (placebo.time_s - placebo.time_s[0]) / (placebo.time_s[-1] - placebo.time_s[0])
    curves = {
        "backwards": np.interp(1.0 - x, own, placebo.gyro_degC[:, 0]),
        "as it ran": np.interp(x, own, placebo.gyro_degC[:, 0]),
        "shifted": np.interp((x + 0.5) % 1.0, own, placebo.gyro_degC[:, 0]),
    }
    chosen = list(curves) if kind == "axes swapped" else [kind] * 3
    T = np.stack([curves[name] for name in chosen], axis=1)
    return replace(run, temperature=TemperatureLog(time_s=time_s, gyro_degC=T))


def _with_drawn_heading(run: Run, *args: Any, **kwargs: Any) -> RunView | str:
    """`view_run`, whose telemetry is told a heading by lot, known, and Earth rate to go with it."""
    view = run_view.view_run(run, *args, **kwargs)
    if isinstance(view, str):
        return view
    rng = np.random.default_rng([int(run.imu.start_s), 33])
    return replace(view, telemetry=_turned(view.telemetry, float(rng.uniform(0.0, 2.0 * np.pi))))


def _turned(telemetry: Telemetry, by_rad: float) -> Telemetry:
    earth_n = omega_ie_n(telemetry.lat_rad)
    C_nb = np.einsum("ij,njk->nik", dcm_from_euler(0.0, 0.0, by_rad), telemetry.C_nb)
    moved = np.einsum("nij,i->nj", C_nb - telemetry.C_nb, earth_n)
    return replace(
        telemetry, C_nb=C_nb, rate_rad_s=telemetry.rate_rad_s + moved, heading_known=True
    )


@dataclass(frozen=True)
class Implant:
    """What is laid over a log: by number, so that each is its own."""

    number: int

    @property
    def form(self) -> str:
        return list(FORMS)[self.number % len(FORMS)]

    @property
    def sigma(self) -> float:
        return SIZES[self.number // len(FORMS) % len(SIZES)]

    @property
    def axis(self) -> int:
        return int(np.random.default_rng([self.number, 31]).integers(3))


def _asked(log: Log, laid: Implant, number: int, reached: float) -> dict:
    """What was implanted in which log."""
    return {
        "log": log.name,
        "with": log.placebo,
        "number": number,
        "form": laid.form,
        "sigma": laid.sigma,
        "reached": reached,
    }


def implanted(log: Log, number: int) -> dict:
    """One implant and what was said of it."""
    laid = Implant(number)
    run, reached = sized(log, laid)
    if reached == 0.0:
        return {"reached": 0.0}
    found = log.diagnosed(run, log.twin)
    target, right = f"gyro_{'xyz'[laid.axis]}", FORMS[laid.form][1]
    if log.starts > 1:  # a drift is a bias of each start there
        right = (*right, "gyro_turn_on_bias", "unknown_function_of_run")
    new = [c for c in found.causes if (c.effect, c.target) not in log.left]
    first = new[0] if new else None
    held = [c for c in new if {c.effect, *(r.effect for r in c.rivals)} & set(right)]
    tied = [c for c in new if c.effect.startswith(log.tied)]
    wrong = [c for c in new if c.named and c.probability > CONFIDENT and c not in held]
    return {
        **_asked(log, laid, number, reached),
        "target": target,
        "found": [f"{c.effect} on {c.target} {c.probability:.2f}" for c in new],
        "seen": bool(new),
        "right": first is not None and first.effect in right and first.target == target,
        "in_set": any(target in (c.target, *(r.target for r in c.rivals)) for c in held),
        "place": target in {p.channel for p in found.where},
        "wrong_confident": bool(wrong),
        "placebo": any(c.probability > 0.5 for c in tied),
        "placebo_named": any(c.named and c.probability > 0.5 for c in tied),
        "placebo_alone": any(not c.rivals for c in tied),
    }


def sealed(log: Log, number: int) -> dict:
    """An implant found on the first half of the log, the twin with it written to a file, and the
    gap of the second half under the file and without.
    """
    laid = Implant(number)
    run, reached = sized(log, laid)
    if reached == 0.0:
        return {"reached": 0.0}
    middle = 0.5 * sum(log.rest)
    first, second = cut_run(run, log.rest[0], middle), cut_run(run, middle, log.rest[1])
    halves = (view_run(half, 0, None, log.twin) for half in (first, second))
    if not all(isinstance(view, RunView) for view in halves):
        return {"reached": 0.0}  # a half that no longer rests
    found = diagnose([first], log.twin, None, DiagnosisSettings(replicates=REPLICATES))
    names = [first.header.run_id]
    all_of_it = _twin_with(log.twin, found, names)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "twin.json"
        made = twin_with_causes(log.twin, found.causes, names, with_table=False)
        path.write_text(to_json(made), encoding="utf-8")
        kept = read_twin(path)
    return {
        **_asked(log, laid, number, reached),
        "target": f"gyro_{'xyz'[laid.axis]}",
        "found": [f"{c.effect} on {c.target} {c.probability:.2f}" for c in found.causes],
        "named": any(c.named for c in found.causes),
        "kept_out": [f"{c.effect} on {c.target}" for c in found.causes if c.kept_out],
        "first_before": gap_nats(first, log.twin),
        "first_after": gap_nats(first, kept),
        "second_before": gap_nats(second, log.twin),
        "second_after": gap_nats(second, kept),
        "second_with_all": gap_nats(second, all_of_it),
        # what the recording shows without the implant
        "second_without": gap_nats(cut_run(log.run, middle, log.rest[1]), log.twin),
    }


def gap_nats(run: Run, twin: TwinModel) -> float:
    """The gap of a run under a twin, all cells together [nats]; about 0 where the twin is right."""
    view = view_run(run, 0, None, twin)
    assert isinstance(view, RunView)
    listed = parse_effects(twin)
    known = twin_traces(listed, view.telemetry, view.name) if listed else None
    always = twin_extra_noise([item for item in listed if item.run_id in ("", view.name)])
    evidence = Evidence([view], twin, always, [known])
    squares = Squares(evidence)
    ratio = squares.ratio(evidence.z[:, None])
    return float(measure_cells(cells_of(evidence, squares), squares.dof, ratio)[2].sum())


def sized(log: Log, laid: Implant) -> tuple[Run, float]:
    """The log with an implant of its whitened size, and the size reached."""
    wanted, form = laid.sigma, FORMS[laid.form][0]
    plain = _whitened(log, log.run)
    reached, amplitude, run = 0.0, 1e-5, log.run
    for _ in range(6):
        run = _laid_over(log.run, form, laid.axis, amplitude, laid.number)
        more = _whitened(log, run)
        if more is None or plain is None or more.shape != plain.shape:
            return log.run, 0.0  # it no longer rests
        reached = float(np.linalg.norm(more - plain))
        if abs(reached - wanted) < 0.05 * wanted or reached == 0.0:
            break
        amplitude *= wanted / reached
    return run, reached


def _whitened(log: Log, run: Run) -> NDArray | None:
    views = [view_run(part, k, None, log.twin) for k, part in enumerate(log.runs(run))]
    seen = [view for view in views if isinstance(view, RunView)]
    return Evidence(seen, log.twin).z if len(seen) == len(views) else None


def _laid_over(run: Run, form: Form, axis: int, amplitude: float, number: int) -> Run:
    imu = run.imu.whole()
    x = (imu.time_s - imu.time_s[0]) / (imu.time_s[-1] - imu.time_s[0])
    dtheta = imu.dtheta_rad.copy()
    dtheta[:, axis] += amplitude * form(x, np.random.default_rng([number, 32])) * imu.dt_s
    return replace(run, imu=replace(imu, dtheta_rad=dtheta))


SAID = {
    "seen": "something new found",
    "place": "its gyro among the places",
    "right": "right on top",
    "in_set": "right or in the set",
    "wrong_confident": "wrong at over 0.9",
    "placebo": "tied to the placebo",
    "placebo_named": "and named",
    "placebo_alone": "and alone",
}
OF_HALVES = (
    "found on the first half",
    "something kept out",
    "gap of the second less",
    "more",
    "more with all that was found",
    "nats of the second before",
    "after",
    "with all",
    "without the implant",
)


def implant_cells(of: list[Record]) -> list[int]:
    """How often each thing was said."""
    return [sum(r[key] for r in of) for key in SAID]


def half_cells(of: list[Record]) -> list[object]:
    """How much of the second half's gap goes with what was found on the first."""
    found = [r for r in of if r["found"]]
    nats = [
        sum(r[f"second_{when}"] for r in found)
        for when in ("before", "after", "with_all", "without")
    ]
    return [
        len(found),
        sum(bool(r["kept_out"]) for r in found),
        sum(r["second_after"] < r["second_before"] for r in found),
        sum(r["second_after"] > r["second_before"] + 1.0 for r in found),
        sum(r["second_with_all"] > r["second_before"] + 1.0 for r in found),
        *(f"{n:.0f}" for n in nats),
    ]


def one(data: str, name: str, kind: str, number: int, halves: bool) -> Record:
    """One implant in one log; `left_out` where it does not rest, with or without it."""
    log = prepared(data, name, kind)
    if log is None:
        return {"left_out": True}
    record = sealed(log, number) if halves else implanted(log, number)
    if not record["reached"]:
        return {"left_out": True}
    return {**record, "as_it_is": list(log.causes)}


def run(
    work: Work,
    *,
    data: Path = ROOT.parent / "shared" / "data",
    each: int = 40,
    first: int = 0,
    placebos: tuple[str, ...] = KINDS,
    logs: tuple[str, ...] = LOGS,
    halves: bool = False,
) -> str:
    """each: implants a log and placebo; halves: found on one half, judged by the other."""
    numbers = range(first, first + each)
    asked = [(str(data), n, k, i, halves) for i in numbers for n in logs for k in placebos]
    rows = [r for r in work.each(one, asked) if "left_out" not in r]
    groups = {"all": rows}
    for key, values in (("sigma", SIZES), ("log", LOGS), ("with", KINDS), ("form", tuple(FORMS))):
        groups |= {f"{value}": [r for r in rows if r[key] == value] for value in values}
    cells, titles = (half_cells, OF_HALVES) if halves else (implant_cells, SAID.values())
    lines = [[name, len(of), *cells(of)] for name, of in groups.items() if of]
    return table(("", "implants", *titles), lines)
