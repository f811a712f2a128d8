"""Pairs of rival effects: which to separate, and how far a set of runs separates them."""

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from enum import StrEnum
from functools import cached_property

import numpy as np

from ins.documents import written
from ins.errors.catalogue import catalogue, effects_named
from ins.records import InputError
from simreal.plan.gram import SAME_COS2, Contender, PairSeparation, RunGrams, separation

CLASSICAL = (  # effects.md, end of section 2: what is confused when the recordings are poor
    "gyro_thermal_linear,gyro_warmup_transient",
    "gyro_thermal_quadratic,gyro_warmup_transient",
    "gyro_thermal_linear,gyro_thermal_rate",
    "gyro_thermal_linear,gyro_thermal_quadratic",
    "gyro_thermal_rate,gyro_thermal_gradient",
    "gyro_thermal_rate,gyro_thermal_lag",
    "gyro_thermal_lag,gyro_thermal_hysteresis",
    "gyro_warmup_transient,gyro_rate_ramp",
    "gyro_misalignment,gyro_magnetic_sensitivity",
    "gyro_misalignment,site_latitude_error",
    "gyro_magnetic_sensitivity,site_latitude_error",
    "gyro_g_sensitivity,gyro_turn_on_bias",
    "platform_settling,accel_warmup_transient",
    "gyro_scale_factor,clock_rate",
    "lever_arm,side_slip",
    "odometer_scale,wheel_slip",
)
TURNED = "gyro_z"  # the gyro that a taxi turns about
TURNING = ("gyro_scale_factor", "gyro_scale_asymmetry", "gyro_scale_thermal", "gyro_lock_in")


@dataclass(frozen=True)
class Inseparable:
    """What no parked recording separates, in words."""

    a: str
    b: str
    why: str


INSEPARABLE = (  # effects.md, end of section 2: no parked recording helps
    Inseparable(
        "turn-on bias of the east gyro",
        "heading error",
        (
            "parked, both are one constant east rate; taxi with GNSS or odometer, "
            "or a surveyed heading, shows the heading itself"
        ),
    ),
    Inseparable(
        "vertical deflection or gravity anomaly",
        "accelerometer bias",
        "parked at one site, both are one constant; record at another site",
    ),
    Inseparable(
        "platform settling",
        "bending of the mounting tray",
        "both move the same two channels; only an instrument beside the unit tells",
    ),
    Inseparable(
        "platform yaw creep",
        "drift of the vertical gyro",
        "parked, both are one rate about z; a heading reference tells",
    ),
)


class PairVerdict(StrEnum):
    """Whether a set of recordings tells two effects apart."""

    SEPARATED = "separated"
    SEPARATED_WHEN_LARGE = "separated_when_large"
    NOT_SEPARATED = "not_separated"
    NOT_TESTABLE = "not_testable"

    @property
    def separates(self) -> bool:
        """The two are told apart, at least where the effect is large."""
        return self in (PairVerdict.SEPARATED, PairVerdict.SEPARATED_WHEN_LARGE)


@written("label a b")
@dataclass(frozen=True)
class Pair:
    """Two rivals."""

    a: Contender
    b: Contender

    @property
    def label(self) -> str:
        return f"{self.a.effect.name} / {self.b.effect.name}"


@dataclass(frozen=True)
class PairAssessment:
    """A pair in a set of runs: what the runs lack to show one of them (in words), or how far each
    is told from the other.

    special : "a" or "b" where that effect is a special case of the other, which has more
    coefficients: the simpler is then preferred, and what has to be told is the other from it.
    """

    pair: Pair
    lacks: str = ""
    a: PairSeparation | None = None  # a true, b the rival
    b: PairSeparation | None = None
    special: str = ""

    @cached_property
    def both(self) -> tuple[PairSeparation, ...]:
        return tuple(
            t for name in "ab" if (t := getattr(self, name)) is not None and name != self.special
        )

    @property
    def cos(self) -> float:
        """Of the two signatures at the shapes that match best; nan where not testable."""
        return max((float(t.cos.max()) for t in self.both), default=np.nan)

    @property
    def cos_typical(self) -> float:
        """Of a true effect of median shape with the best match of its rival."""
        return max((float(np.median(t.cos)) for t in self.both), default=np.nan)

    @property
    def delta_needed(self) -> float:
        return max((float(t.delta_needed.max()) for t in self.both), default=np.nan)

    @property
    def delta_needed_typical(self) -> float:
        return max((float(np.median(t.delta_needed)) for t in self.both), default=np.nan)

    @cached_property
    def margin(self) -> float:
        """Usual size over the size needed, whichever of the two is harder to tell; 0 where not
        testable.
        """
        return min((t.margin for t in self.both), default=0.0)

    @cached_property
    def margin_high(self) -> float:
        """The same for effects at the upper end of their usual size."""
        return min((t.margin_high for t in self.both), default=0.0)

    @property
    def score(self) -> float:
        """0 to 1: half for effects at the upper end of the usual range, half for those of its
        geometric mean.
        """
        return 0.5 * min(self.margin, 1.0) + 0.5 * min(self.margin_high, 1.0)

    @property
    def verdict(self) -> PairVerdict:
        if self.lacks:
            return PairVerdict.NOT_TESTABLE
        if self.margin >= 1.0:
            return PairVerdict.SEPARATED
        if self.margin_high >= 1.0:
            return PairVerdict.SEPARATED_WHEN_LARGE
        return PairVerdict.NOT_SEPARATED


def special_case(runs: Sequence[RunGrams], pair: Pair) -> str:
    """Which of a pair ("a", "b", or neither "") is a special case of the other, as rich runs
    show.
    """
    judged = assess(runs, pair)
    for name, e, other, t in (("a", pair.a, pair.b, judged.a), ("b", pair.b, pair.a, judged.b)):
        more = (
            len(other.effect.coefficients) > len(e.effect.coefficients)
            and other.effect.repeats == e.effect.repeats == "R"
        )
        if more and t is not None and t.delta.min() > 0.0 and float((t.cos**2).min()) > SAME_COS2:
            return name
    return ""


def assess(runs: Sequence[RunGrams], pair: Pair, special: str = "") -> PairAssessment:
    """A pair in a set of runs. special: as in `PairAssessment`."""
    if not runs:
        return PairAssessment(pair, "a recording")
    telemetry = [run.telemetry for run in runs]
    for e in (pair.a, pair.b):
        if lacks := e.effect.needs(telemetry, e.target):
            return PairAssessment(pair, lacks)
        if any(e.key not in run.columns for run in runs):
            return PairAssessment(pair, "a temperature that all of the runs log")
    return PairAssessment(
        pair, "", separation(runs, pair.a, pair.b), separation(runs, pair.b, pair.a), special
    )


def read_pair(text: str) -> Pair:
    """The pair in "A,B" or "A@gyro_y,B@gyro_y"; InputError for names that are not in the
    catalogue.
    """
    names = [part.strip() for part in text.split(",")]
    if len(names) != 2 or not all(names):
        raise InputError(
            f"--separate {text!r}: needed two effects with a comma between them, for example"
            f" {CLASSICAL[0]}"
        )
    first = contender(names[0])
    second = contender(names[1], beside=first.target)
    if first.key == second.key:
        raise InputError(
            f"--separate {text!r}: both are {first.label}, needed two different effects"
        )
    return Pair(first, second)


def contender(text: str, *, beside: str = "") -> Contender:
    """An effect by name and, after "@", its target; without one the rival's (`beside`) or else the
    first it may have.
    """
    name, _, target = text.partition("@")
    found = effects_named(name)
    if not found:
        known = sorted({e.name for e in catalogue()} | {e.id for e in catalogue()})
        near = get_close_matches(name, known, n=3, cutoff=0.5)
        hint = f"nearest: {', '.join(near)}" if near else f"needed one of {', '.join(known)}"
        raise InputError(f"effect {name!r} is not in the catalogue; {hint}")
    # noise of one run, a machine's, is an event without a signature
    signed = [e for e in found if e.repeats != "S" and not getattr(e, "noise_formula", None)]
    if not signed:
        raise InputError(
            f"effect {name!r} is noise: it has no signature to compare, needed an effect that"
            " has one"
        )
    targets = [t for e in signed for t in e.targets]
    usual = TURNED if signed[0].id in TURNING and TURNED in targets else targets[0]
    wanted = target or (beside if beside in targets else usual)
    for effect in signed:
        if wanted in effect.targets:
            return Contender(effect, wanted)
    raise InputError(
        f"effect {name!r} on {wanted!r}: needed one of {', '.join(dict.fromkeys(targets))}"
    )
