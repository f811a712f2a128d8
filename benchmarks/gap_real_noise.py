"""Effects implanted into real recordings at rest, and a placebo: what the diagnosis says on real
noise.

    python -m benchmarks.gap_real_noise [--data ../shared/data] [--each 40]
        [--placebo KIND ...] [--until HH:MM] [-o FILE]

Of each log of `benchmarks.real_logs` that rests: its noise by `recal twin fit`, and what the log
itself shows under that noise taken into the twin (all causes found on the log as it is). Then an
effect is laid over a gyro, of forms that the catalogue does not use (a step that takes seconds, a
drift that bends, a triangle wave, uniform noise), 5 to 40 sigma of that log. Every log is given a
placebo for a temperature, that of the copter's third IMU stretched over the log: backwards, as it
ran, or with a different curve on each axis (backwards, as it ran, and shifted by half). A named
cause that rests on it with a probability above a half is a hit of the placebo; it is said which of
them stand alone, without any rival.
"""

import argparse
import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.real_logs import convert_all
from ins.records import Run, TemperatureLog, TwinModel
from ins.twin_file import twin_from_dict
from recal.service.twin.fit import fit_twin
from simreal.evidence.run_view import RunView, view_run
from simreal.evidence.whitened import Evidence
from simreal.inference.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from simreal.twin.write_back import twin_with_causes

LOGS = ("ln100", "apm", "copter-imu1", "copter-imu2", "copter-imu3")
PLACEBO = "copter-imu3"
SIZES = (5.0, 10.0, 20.0, 40.0)
REPLICATES = 100
CONFIDENT = 0.9
KINDS = ("backwards", "as it ran", "axes swapped")
THERMAL = ("gyro_thermal", "unknown_function_of_temperature", "accel_thermal", "gyro_noise_thermal")
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
        ("gyro_angle_random_walk", "gyro_quantization", "timestamp_jitter", "gyro_noise_thermal"),
    ),
}


@dataclass(frozen=True)
class Log:
    """A real log with its placebo, its twin, what is found on it as it is, and what still is with
    all of that in the twin: an implant is judged by what it adds to this.
    """

    name: str
    placebo: str
    run: Run
    twin: TwinModel
    causes: tuple[str, ...]
    left: frozenset[tuple[str, str]]


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.gap_real_noise", description=__doc__
    )
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--each", type=int, default=40, help="implants a log")
    parser.add_argument("--placebo", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--until", default="", help="UTC, HH:MM: begin no implant later")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    rows, notes = [], []
    logs = prepared_logs(options.data, options.placebo)
    for log in logs:
        left = ", ".join(f"{effect} on {target}" for effect, target in sorted(log.left))
        shown = ", ".join(log.causes)
        notes.append(
            f"{log.name}, placebo {log.placebo}: as it is, under its own noise:"
            f" {shown or 'nothing'}; with that in the twin: {left or 'nothing'}"
        )
        print(notes[-1], flush=True)
    for k in range(options.each):
        for log in logs:
            if options.until and datetime.now(UTC).strftime("%H:%M") >= options.until:
                continue
            row = implanted(log, k)
            if row["reached"] > 0.0:
                rows.append(row)
                print(json.dumps(row), flush=True)
    for line in summary(rows):
        print(line)
    if options.output:
        text = json.dumps({"rows": rows, "summary": summary(rows), "logs": notes}, indent=1)
        options.output.write_text(text + "\n", encoding="utf-8")


def prepared_logs(data: Path, kinds: Sequence[str] = KINDS) -> list[Log]:
    """All logs that rest, each under a twin of its own."""
    out = []
    with tempfile.TemporaryDirectory() as folder:
        runs = convert_all(data, Path(folder))
        placebo = runs[PLACEBO].temperature
        assert placebo is not None
        for name in LOGS:
            twin = fit_twin(runs[name]).twin
            if twin is None or isinstance(view_run(runs[name], 0, None, twin), str):
                print(f"{name}: no rest for a fit of its noise, left out", flush=True)
                continue
            for kind in kinds:
                out.append(_prepared(name, kind, with_placebo(runs[name], placebo, kind), twin))
    return out


def _prepared(name: str, kind: str, run: Run, twin: TwinModel) -> Log:
    found = diagnosed(run, twin)
    more = twin_with_causes(twin, found.causes, [run.header.run_id], with_table=False)
    again = twin_from_dict(json.loads(json.dumps(more)), source="twin", name="twin")
    said = tuple(f"{c.effect} on {c.target} {c.probability:.2f}" for c in found.causes)
    left = frozenset((c.effect, c.target) for c in diagnosed(run, again).causes)
    return Log(name, kind, run, again, said, left)


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


def diagnosed(run: Run, twin: TwinModel) -> Diagnosis:
    return diagnose([run], twin, None, DiagnosisSettings(replicates=REPLICATES))


def implanted(log: Log, number: int) -> dict:
    """One implant and what was said of it."""
    rng = np.random.default_rng([number, 31])
    form = list(FORMS)[number % len(FORMS)]
    size = SIZES[number // len(FORMS) % len(SIZES)]
    axis = int(rng.integers(3))
    run, reached = sized(log, FORMS[form][0], axis, size, number)
    found = diagnosed(run, log.twin)
    target, right = f"gyro_{'xyz'[axis]}", FORMS[form][1]
    new = [c for c in found.causes if (c.effect, c.target) not in log.left]
    first = new[0] if new else None
    held = [c for c in new if {c.effect, *(r.effect for r in c.rivals)} & set(right)]
    tied = [c for c in new if c.effect.startswith(THERMAL)]
    wrong = [c for c in new if c.named and c.probability > CONFIDENT and c not in held]
    return {
        "log": log.name,
        "with": log.placebo,
        "form": form,
        "sigma": size,
        "reached": reached,
        "target": target,
        "found": [f"{c.effect} on {c.target} {c.probability:.2f}" for c in new],
        "seen": bool(new),
        "right": first is not None and first.effect in right and first.target == target,
        "in_set": any(target in (c.target, *(r.target for r in c.rivals)) for c in held),
        "place": target in {p.channel for p in found.where},
        "wrong_confident": bool(wrong),
        "placebo": any(c.probability > 0.5 for c in tied),
        "placebo_alone": any(not c.rivals for c in tied),
    }


def sized(log: Log, form: Form, axis: int, wanted: float, number: int) -> tuple[Run, float]:
    """The log with a form of the wanted whitened size on a gyro, and the size reached."""
    plain = _whitened(log, log.run)
    reached, amplitude, run = 0.0, 1e-5, log.run
    for _ in range(6):
        run = _laid_over(log.run, form, axis, amplitude, number)
        more = _whitened(log, run)
        if more is None or plain is None or more.shape != plain.shape:
            return log.run, 0.0  # it no longer rests
        reached = float(np.linalg.norm(more - plain))
        if abs(reached - wanted) < 0.05 * wanted or reached == 0.0:
            break
        amplitude *= wanted / reached
    return run, reached


def _laid_over(run: Run, form: Form, axis: int, amplitude: float, number: int) -> Run:
    imu = run.imu.whole()
    x = (imu.time_s - imu.time_s[0]) / (imu.time_s[-1] - imu.time_s[0])
    dtheta = imu.dtheta_rad.copy()
    dtheta[:, axis] += amplitude * form(x, np.random.default_rng([number, 32])) * imu.dt_s
    return replace(run, imu=replace(imu, dtheta_rad=dtheta))


def _whitened(log: Log, run: Run) -> NDArray | None:
    view = view_run(run, 0, None, log.twin)
    return Evidence([view], log.twin).z if isinstance(view, RunView) else None


def summary(rows: list[dict]) -> list[str]:
    """Shares by size and by log."""
    out = [_line("all", rows)]
    out += [_line(f"{s:g} sigma", [r for r in rows if r["sigma"] == s]) for s in SIZES]
    out += [_line(name, [r for r in rows if r["log"] == name]) for name in LOGS]
    out += [_line(f"placebo {k}", [r for r in rows if r["with"] == k]) for k in KINDS]
    out += [_line(form, [r for r in rows if r["form"] == form]) for form in FORMS]
    return [line for line in out if "of 0:" not in line]


def _line(name: str, rows: list[dict]) -> str:
    counts = {
        key: sum(r[key] for r in rows)
        for key in (
            "seen",
            "place",
            "right",
            "in_set",
            "wrong_confident",
            "placebo",
            "placebo_alone",
        )
    }
    said = ", ".join(f"{key.replace('_', ' ')} {n}" for key, n in counts.items())
    return f"{name}, of {len(rows)}: {said}"


if __name__ == "__main__":
    main()
