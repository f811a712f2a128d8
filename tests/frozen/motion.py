"""What the program says of when a vehicle stands and moves: the answer of each part that asks.

Every caller below is asked of a run; times are seconds of the run, a reason is its code. An answer
holds the times as estimates, with a sigma of which a frozen mean may move by 0.02 s, and its words
with "#" where a time stood. CALLERS is the one place to change where an entry point moves.
"""

import json
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from alignment import gyrocompass
from alignment.motion import imu_faults, inertial, kinds, parked_seconds, stillness
from alignment.motion.seconds import LogSeconds
from alignment.motion.speeds import watched_seconds
from infield.misalignment import azimuth_runs
from infield.replay import free_inertial as replay
from infield.session import log, pipeline
from infield.session.parked import stretches
from infield.thermal import ramp_runs
from infield.thermometer.gyro_temperature import GyroTemperature, gyro_temperature, too_short
from ins.errors import telemetry
from ins.records import ImuSource, InputError
from ins.units import DEG
from ins.verdicts import Reason
from simreal.evidence import run_view
from tests.frozen.answers import MEAN_SIGMAS, Answer
from tests.frozen.motion_runs import Case

TIME_SIGMA = 0.02 / MEAN_SIGMAS  # s of a time, deg of a turn
DECIMALS = 2
KINDS = {
    kinds.STILL: "still",
    kinds.DISTURBED: "disturbed",
    kinds.ROLLING: "rolling",
    kinds.AIRBORNE: "airborne",
    kinds.UNKNOWN: "unknown",
}
VIEW_KINDS = {
    telemetry.PARKED: "parked",
    telemetry.ROLLING: "rolling",
    telemetry.AIRBORNE: "airborne",
}

# The callers --------------------------------------------------------------------------------------


def repairs(case: Case) -> Any:
    """Clipping, shocks and dropouts of the parked time, and shakes that were recorded rightly."""
    seconds = watched_seconds(case.run)
    rest = inertial.first_rest(seconds)
    if rest is None:
        return None
    faults = imu_faults.repair(case.run.imu, seconds, rest[0], case.run.imu.end_s)[1]
    return [[*times(f.start_s, f.end_s), f.reason] for f in faults]


def alignment(case: Case) -> Any:
    """`recal align`."""
    found = gyrocompass.align(
        compensated(case),
        case.run.header.site,
        case.twin,
        bias_sigma_deg_h=first_sigma_deg_h(case),
        phases=case.run.phases,
        read=gyrocompass.ReadLog(seconds=compensated_seconds(case)),
    )
    return {
        "verdict": found.verdict,
        "reasons": words(found.reasons),
        "time_s": rounded(found.time_s),
        "parked_s": rounded(found.duration_s),
        "phases": [[*times(p.start_s, p.end_s), p.phase] for p in found.phases],
        "excluded": spans(found.excluded),
    }


def update(case: Case) -> Any:
    """`recal update` of this run alone: its motion, phases, stretches and the chain's windows."""
    result = pipeline.update_calibration([case.run], case.table, case.twin)
    found = result.sessions[0]
    answer = {"outcome": found.verdict.outcome, "reasons": words(found.verdict.reasons)}
    estimate = found.estimate
    if estimate is None:
        return answer
    answer["motion"] = motion_of(estimate.motion)
    answer["phases"] = [
        [*times(p.start_s, p.end_s), p.phase] for p in stillness.detect_phases(estimate.motion)
    ]
    if found.chain is not None:
        answer["chain"] = [rounded(p.time_s) for p in found.chain.points]
    if estimate.parked is not None:
        answer["stretches"] = [
            [*times(s.seconds.start_s[0], s.seconds.end_s[-1]), rounded(s.still_s)]
            for s in estimate.parked.stretches
        ]
        answer["left_out"] = spans(estimate.parked.left_out)
    return answer


def free_replay(case: Case) -> Any:
    """`recal replay --no-aided`: the parked span and the stops behind it."""
    found = replay.replay(case.run, [choice(case)], case.twin, aided=False)
    stops = found.tables[0].stops if found.tables else ()
    return {
        "verdict": found.verdict,
        "alignment": span_of(found.alignment_span),
        "parked_until_s": None if found.parked_until_s is None else rounded(found.parked_until_s),
        "stops": [[*times(s.start_s, s.end_s), s.seen_by] for s in stops],
    }


def aided_replay(case: Case) -> Any:
    """`recal replay` with GNSS: the stands and the start."""
    if case.run.gnss is None:
        return None
    found = replay.replay(case.run, [choice(case)], case.twin).aided
    if found is None:
        return None
    start = found.found
    return {
        "verdict": found.verdict,
        "stands": [span_of(s) for s in found.stands],
        "start": None if start is None else [*times(*start.span), start.method],
    }


def azimuth_stops(case: Case) -> Any:
    """`recal misalignment`: stops between turns, how long each was used, how far it turned."""
    stops, left_out = azimuth_runs.find_stops(case.run, case.twin)
    found = [
        [*times(s.start_s, s.end_s), rounded(s.used_s), rounded(s.turn_rad / DEG)] for s in stops
    ]
    return {"stops": found, "left_out": [told(why) for why in left_out]}


def chamber_ramps(case: Case) -> Any:
    """`recal thermal fog` and `rlg`: minutes kept, ramps, what was moved or bumped."""
    if case.run.header.gyro_technology == "mems":
        return None
    found = ramp_runs.ramp_run(case.run, case.twin)
    return {
        "minutes": found.time_s.size,
        "legs": [
            [*times(found.time_s[leg.start], found.time_s[leg.end - 1]), leg.direction]
            for leg in found.legs
        ],
        "excluded": spans(found.excluded),
        "turned_deg": rounded(found.turned_rad / DEG),
    }


def parked_rests(case: Case) -> Any:
    """The rests of a unit that finds no north, and the places that each of them falls into."""
    rests = stretches.stationary_segments(case.run)
    places = []
    for stretch in rests.stretches:
        for place in parked_seconds.parked_places(compensated_seconds(case), *stretch):
            ends = times(place.start_s[0], place.end_s[-1])
            places.append([*ends, bool(place.moved), motion_of(place.motion)["spans"]])
    return {
        "stretches": [span_of(s) for s in rests.stretches],
        "left_out": spans(rests.left_out),
        "why": told(rests.why),
        "places": places,
    }


def gap_view(case: Case) -> Any:
    """`recal diagnose` and `plan`: the parked stretch and the kind of every second."""
    found = run_view.view_run(case.run, 0, case.table, case.twin)
    if isinstance(found, str):
        return "not taken"
    kind = found.telemetry.kind
    return {
        "parked": span_of((found.start_s, found.end_s)),
        "kinds": labelled(found.seconds.end_s, kind, [VIEW_KINDS[int(k)] for k in kind], 1.0),
        "notes": len(found.notes),
    }


CALLERS: dict[str, Callable[[Case], Any]] = {
    "repairs": repairs,
    "alignment": alignment,
    "update": update,
    "free_replay": free_replay,
    "aided_replay": aided_replay,
    "azimuth_stops": azimuth_stops,
    "chamber_ramps": chamber_ramps,
    "parked_rests": parked_rests,
    "gap_view": gap_view,
}

# What they are given and how their answers are written --------------------------------------------


def compensated(case: Case) -> ImuSource:
    """The log less table and twin, as the commands hand it on."""
    return log.compensated_imu(case.run, case.table, _temperature(case), case.twin)


def compensated_seconds(case: Case) -> LogSeconds:
    """The seconds of that log."""
    return log.compensated_seconds(case.run, case.table, _temperature(case), case.twin)


def _temperature(case: Case) -> GyroTemperature | None:
    if case.run.temperature is None or too_short(case.run.temperature):
        return None
    return gyro_temperature(case.run.temperature)


def first_sigma_deg_h(case: Case) -> np.ndarray | None:
    """What `recal align` takes for the gyros' sigma: None of a unit that no store knows."""
    if case.run.temperature is None or too_short(case.run.temperature):
        return None
    T = gyro_temperature(case.run.temperature).temperature_degC[0]
    sigma = np.array([case.table.sigma_deg_h(k, T[k])[0] for k in range(3)])
    return np.hypot(sigma, case.twin.gyro.turn_on_deg_h)


def choice(case: Case) -> replay.TableChoice:
    return replay.TableChoice(role="active", table=case.table, origin="frozen answers")


def rounded(value: float) -> float | None:
    """To 0.01; None for what is not a number."""
    return round(float(value), DECIMALS) + 0.0 if np.isfinite(value) else None


def times(*seconds: float) -> list[float | None]:
    return [rounded(s) for s in seconds]


def span_of(span: tuple[float, float] | None) -> list[float | None] | None:
    return None if span is None else times(*span)


def spans(found: Any) -> list[list[Any]]:
    """Spans with their reasons."""
    return [[*times(s.start_s, s.end_s), *told(s.reason)] for s in found]


def words(reasons: Any) -> list[str]:
    """Codes of reasons."""
    return [str(reason.code) for reason in reasons]


def told(why: Reason | str | None) -> list[Any]:
    """Code and numbers of a reason that names times, or the cause of a span."""
    if not isinstance(why, Reason):
        return [str(why or "")]
    values = why.values.values()
    inner = [told(value) for value in values if isinstance(value, Reason)]
    return [str(why.code), *times(*filter(_number, values)), *inner]


def motion_of(motion: stillness.Motion) -> dict[str, Any]:
    """Spans of one kind and cause, and the epochs after which the parked heading is a new one."""
    cause = motion.cause if len(motion.cause) else np.full(len(motion.kind), "", dtype=object)
    names = [f"{KINDS[int(k)]} {c}".strip() for k, c in zip(motion.kind, cause)]
    jolts = motion.time_s[motion.jolt_rad >= stillness.NEW_PLACE_RAD]
    return {
        "spans": labelled(motion.time_s, motion.kind, names, 0.0),
        "new_heading_s": times(*jolts),
    }


def labelled(ends_s: np.ndarray, kind: np.ndarray, names: list[str], first_s: float) -> list[list]:
    """Runs of one name as [start, end, name]; epochs end at their time, the first lasts first_s."""
    edges = [0, *(k for k in range(1, len(names)) if names[k] != names[k - 1]), len(names)]
    starts = np.append(ends_s[0] - first_s, ends_s[:-1])
    return [[*times(starts[a], ends_s[b - 1]), names[a]] for a, b in pairwise(edges)]


# Answers ------------------------------------------------------------------------------------------


def of_motion(case: Case) -> Answer:
    """The answer of every caller; a log that one of them does not take is an answer too."""
    words: dict[str, str] = {}
    estimates: dict[str, list[float]] = {}
    for name, ask in CALLERS.items():
        try:
            found = ask(case)
        except InputError as error:
            found = {"error": type(error).__name__}
        seen: list[float] = []
        words[name] = json.dumps(without_times(found, seen), separators=(",", ":"))
        estimates |= {f"{name} {k}": [value, TIME_SIGMA] for k, value in enumerate(seen)}
    return {"words": words, "estimates": estimates}


def without_times(answer: Any, seen: list[float]) -> Any:
    """The answer with "#" for every number, which goes to `seen`."""
    if isinstance(answer, dict):
        return {key: without_times(value, seen) for key, value in answer.items()}
    if isinstance(answer, list):
        return [without_times(value, seen) for value in answer]
    if not _number(answer):
        return answer
    seen.append(float(answer))
    return "#"


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
