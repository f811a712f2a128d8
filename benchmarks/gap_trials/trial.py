"""Blind trials by seed: runs with a planted effect, the same runs without it, the twin and table,
and what was planted.

The seed alone fixes headings, taxis, temperatures, noise, effects, targets and parameters;
`with_sizes` keeps all of them and scales the effects only, so that a study can bring the whitened
norm of runs minus runs_without to what it wants.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from benchmarks.gap_trials import outside, runs
from benchmarks.gap_trials.effect import Effect
from benchmarks.gap_trials.effects import effect_named, possible
from benchmarks.gap_trials.runs import Base, Plan
from benchmarks.gap_trials.seen import Seen, run_of, streams_of
from ins.records import InputError, Run, TwinModel

SOURCES = {"trajectories": runs.base_runs, "pyins": outside.base_runs}
WRONG_NOISE = {  # which of the declared white noises is off, and what may name it
    "gyro": ("gyro_angle_random_walk",),
    "accel": ("accel_noise", "platform_sway"),
    "both": ("gyro_angle_random_walk", "accel_noise", "platform_sway"),
}


@dataclass(frozen=True, kw_only=True)
class Planted:
    """One effect in a trial, in every run that it touches. size 1 is the middle of its usual range.

    answers: the names that are right for it; targets: its target first, then others that name the
    same thing; confounded: names that these recordings can hardly tell from it (see Effect).
    """

    effect: str
    target: str
    parameters: dict[str, Any]
    size: float
    answers: tuple[str, ...]
    targets: tuple[str, ...]
    confounded: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Trial:
    """runs minus runs_without is the effect alone: same noise, bit for bit. truth is empty where
    nothing is planted.
    """

    seed: int
    plan: str
    source: str
    twin: TwinModel
    table: dict[str, Any]
    truth: tuple[Planted, ...]
    runs: tuple[Run, ...]
    runs_without: tuple[Run, ...]
    seen: tuple[Seen, ...]

    def with_sizes(self, sizes: Sequence[float]) -> "Trial":
        """The same trial with other size factors of its effects (one each), same noise and
        parameters.
        """
        if len(sizes) != len(self.truth):
            raise InputError(f"trial {self.seed}: {len(sizes)} sizes, needed {len(self.truth)}")
        if any(planted.effect == "declared_noise" for planted in self.truth):
            raise InputError(f"trial {self.seed}: a declared noise has no size")
        truth = tuple(
            replace(planted, size=float(size)) for planted, size in zip(self.truth, sizes)
        )
        bases = [Base(run, seen) for run, seen in zip(self.runs_without, self.seen)]
        return replace(self, truth=truth, runs=tuple(lay_over(base, truth) for base in bases))

    def truth_dict(self) -> dict[str, Any]:
        """What was planted, for a file beside the trial."""
        planted = [asdict(p) for p in self.truth]
        return {"seed": self.seed, "plan": self.plan, "source": self.source, "planted": planted}


def draw_trial(
    seed: int,
    *,
    plan: str = "four",
    effects: int = 1,
    names: Sequence[str] | None = None,
    source: str = "trajectories",
    with_gnss: bool = True,
    parked_s: float = runs.PARKED_S,
) -> Trial:
    """A trial with so many effects (0: none) of their usual sizes, drawn from `names` or from all
    that the plan can show.

    Two effects have different targets. source: "trajectories", or "pyins" for ideal sensors, noise
    and temperatures that share no code with the project. InputError on an unknown plan, name or
    source, or where too few effects are possible.
    """
    chosen = replace(runs.plan_named(plan), with_gnss=with_gnss, parked_s=parked_s)
    table, twin, bases = _bases(seed, chosen, source)
    rng = np.random.default_rng([seed, 2])
    candidates = possible(_has(chosen), names)
    truth = _draw_effects(rng, candidates, effects, tuple(base.seen for base in bases))
    return Trial(
        seed=seed,
        plan=plan,
        source=source,
        twin=twin,
        table=table,
        truth=truth,
        runs=tuple(lay_over(base, truth) for base in bases),
        runs_without=tuple(base.run for base in bases),
        seen=tuple(base.seen for base in bases),
    )


def draw_noise_trial(
    seed: int,
    *,
    plan: str = "four",
    off: float = 0.05,
    source: str = "trajectories",
    with_gnss: bool = True,
    parked_s: float = runs.PARKED_S,
) -> Trial:
    """A trial whose unit has white noise `off` above or below what its twin declares, and nothing
    else.

    runs_without have the declared noise, from the same draws.
    """
    rng = np.random.default_rng([seed, 3])
    which = str(rng.choice(sorted(WRONG_NOISE)))
    factor = 1 + off * (1.0 if rng.random() < 0.5 else -1.0)
    chosen = replace(runs.plan_named(plan), with_gnss=with_gnss, parked_s=parked_s)
    table, twin, without = _bases(seed, chosen, source)
    _, _, bases = _bases(seed, chosen, source, unit_twin=noisier(twin, which, factor))
    targets = [
        f"{sensor}_{axis}"
        for sensor in ("gyro", "accel")
        if which in (sensor, "both")
        for axis in "xyz"
    ]
    planted = Planted(
        effect="declared_noise",
        target=targets[0],
        parameters={"which": which, "factor": factor},
        size=1.0,
        answers=WRONG_NOISE[which],
        targets=(*targets, *(() if which == "gyro" else ("vehicle",))),
    )
    return Trial(
        seed=seed,
        plan=plan,
        source=source,
        twin=twin,
        table=table,
        truth=(planted,),
        runs=tuple(base.run for base in bases),
        runs_without=tuple(base.run for base in without),
        seen=tuple(base.seen for base in bases),
    )


def noisier(twin: TwinModel, which: str, factor: float) -> TwinModel:
    """A twin whose white gyro or accelerometer noise (or both) is this many times as large."""
    gyro, accel = twin.gyro, twin.accel
    if which in ("gyro", "both"):
        gyro = replace(gyro, arw_deg_sqrt_h=factor * gyro.arw_deg_sqrt_h)
    if which in ("accel", "both"):
        accel = replace(accel, vrw_ug_sqrt_hz=factor * accel.vrw_ug_sqrt_hz)
    return replace(twin, gyro=gyro, accel=accel)


def lay_over(base: Base, truth: Sequence[Planted]) -> Run:
    """A run with the planted effects; those that count pulses come last. The run itself where
    nothing changes.
    """
    streams = streams_of(base.run)
    for planted in sorted(truth, key=lambda p: p.effect.endswith("quantization")):
        effect = effect_named(planted.effect)
        streams = effect.lay(streams, base.seen, planted.target, planted.parameters, planted.size)
    return run_of(base.run, streams) if truth else base.run


def _bases(
    seed: int, plan: Plan, source: str, *, unit_twin: TwinModel | None = None
) -> tuple[dict[str, Any], TwinModel, tuple[Base, ...]]:
    if source not in SOURCES:
        raise InputError(f"trial source {source!r}, needed one of {', '.join(SOURCES)}")
    table, twin = runs.draw_table(np.random.default_rng([seed, 0])), runs.rlg_twin()
    bases = SOURCES[source](seed, plan, table=table, twin=twin, unit_twin=unit_twin)
    return table, twin, bases


def _has(plan: Plan) -> frozenset[str]:
    have = {"odometer"} | ({"gnss"} if plan.with_gnss else set())
    return frozenset(
        have | ({"taxi"} if plan.taxi else set()) | ({"runs"} if len(plan.starts) > 1 else set())
    )


def _draw_effects(
    rng: np.random.Generator, candidates: tuple[Effect, ...], count: int, seen: tuple[Seen, ...]
) -> tuple[Planted, ...]:
    planted: list[Planted] = []
    for _ in range(count):
        taken = {p.target for p in planted}
        pairs = [(e, target) for e in candidates for target in e.targets if target not in taken]
        if not pairs:
            raise InputError(f"trial: no effect left to plant after {len(planted)} of {count}")
        names = sorted({e.name for e, _ in pairs})
        name = names[int(rng.integers(len(names)))]
        matching = [pair for pair in pairs if pair[0].name == name]
        effect, target = matching[int(rng.integers(len(matching)))]
        planted.append(
            Planted(
                effect=name,
                target=target,
                parameters=effect.draw(rng, seen),
                size=1.0,
                answers=effect.right_answers,
                targets=(target, *(t for t in effect.accepted if t != target)),
                confounded=effect.confounded,
            )
        )
    return tuple(planted)
