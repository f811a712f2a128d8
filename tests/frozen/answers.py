"""What is kept of a result's document, and how two answers differ.

An answer holds words (verdicts, codes of reasons, names of causes), which have to be the same, and
estimates by name, each a mean with its sigma: a mean may move by MEAN_SIGMAS of its sigma, a sigma
by SIGMA_SHARE of itself. Only keys of ../shared/formats.md are read, so that an answer does not
depend on how the program is built inside.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

MEAN_SIGMAS = 0.05
SIGMA_SHARE = 0.02
DIGITS = 6  # of an estimate that is written
STATES = ("vn_m_s", "ve_m_s", "vd_m_s", "roll_deg", "pitch_deg", "heading_deg")
PLACES = {"north": "lat_deg", "east": "lon_deg", "down": "height_m"}
METRES = {"lat_deg": 111_000.0, "lon_deg": 111_000.0, "height_m": 1.0}  # of one unit, about
AXES = ("x", "y", "z")

Document = Mapping[str, Any]
Answer = dict[str, Any]


def of_session(document: Document) -> Answer:
    """The answer of an `update.json`: the merged table, node by node, and the heading error."""
    estimates = {}
    for axis, nodes in document["table_after"].get("axes", {}).items():
        for T, mean, sigma in zip(
            nodes["temperature_degC"], nodes["bias_deg_h"], nodes["sigma_deg_h"]
        ):
            estimates[f"{axis} {T:g} degC"] = _pair(mean, sigma)
    heading = document.get("heading_error") or {}
    if heading.get("value_mrad") is not None:
        estimates["heading mrad"] = _pair(heading["value_mrad"], heading["sigma_mrad"])
    seen = {a: document["observability"].get(a, {}).get("verdict") for a in AXES}
    return _answer(document, estimates, observability=seen)


def of_aided(document: Document) -> Answer:
    """The answer of the aided part of a `replay.json`: the last state and the antenna."""
    aided = document.get("aided") or {}
    end = aided.get("end") or {}
    estimates = {n: _pair(end[n], end[f"sigma_{n}"]) for n in STATES if n in end}
    for direction, key in PLACES.items():
        if key in end:
            sigma_m = end[f"sigma_{direction}_m"]
            estimates[key] = _pair(end[key], sigma_m / METRES[key], digits=12)
    for sensor, unit in (("gyro", "deg_h"), ("accel", "ug")):
        for axis in AXES:
            name = f"{sensor}_bias_{axis}_{unit}"
            if name in end:
                estimates[name] = _pair(end[name], end[f"sigma_{name}"])
    said = {"aided": aided.get("verdict"), "aided_reasons": aided.get("reason_codes")}
    return _answer(document, estimates, grade=aided.get("grade"), **said)


def of_diagnosis(document: Document) -> Answer:
    """The answer of a `diagnosis.json`: verdict, causes in their order, their parameters."""
    estimates = {"score": _pair(document["gap"]["score"], 1.0)}
    named = []
    for cause in document["causes"]:
        name = f"{cause['effect']} {cause['target']}"
        named.append(name)
        estimates[f"{name} probability"] = _pair(cause["probability"], 1.0)
        for key, found in cause["parameters"].items():
            if isinstance(found, dict) and found.get("sigma"):
                estimates[f"{name} {key}"] = _pair(found["value"], found["sigma"])
    where = sorted({f"{place['channel']} {place['phase']}" for place in document["where"]})
    left = document["unexplained"]["present"]
    return _answer(document, estimates, causes=named, where=where, left=left)


def of_twin_fit(document: Document) -> Answer:
    """The answer of a `twin_fit.json`: what the recording identifies, and the names of the rest."""
    found = document["parameters"]
    estimates = {p["name"]: _pair(p["value"], p["sigma"]) for p in found if p["identified"]}
    rest = sorted(p["name"] for p in found if not p["identified"])
    return _answer(document, estimates, not_identified=rest)


def differences(frozen: Answer, now: Answer) -> Iterator[str]:
    """A line for each word or estimate that is not as it was frozen."""
    words, words_now = frozen["words"], now["words"]
    for key in sorted(words.keys() | words_now.keys()):
        if words.get(key) != words_now.get(key):
            yield f"{key}: {words.get(key)} is now {words_now.get(key)}"
    was, found = frozen["estimates"], now["estimates"]
    for name in sorted(was.keys() ^ found.keys()):
        yield f"{name}: estimated {'before' if name in was else 'now'} only"
    for name in sorted(was.keys() & found.keys()):
        yield from _moved(name, was[name], found[name])


def _moved(name: str, was: list[float], now: list[float]) -> Iterator[str]:
    (mean, sigma), (mean_now, sigma_now) = was, now
    if abs(mean_now - mean) > MEAN_SIGMAS * sigma:
        moved = (mean_now - mean) / sigma if sigma else np.inf
        yield f"{name}: {mean:.6g} is now {mean_now:.6g}, {moved:+.2f} sigma"
    if abs(sigma_now - sigma) > SIGMA_SHARE * sigma:
        yield f"{name}: sigma {sigma:.4g} is now {sigma_now:.4g}"


def _answer(document: Document, estimates: dict[str, list[float]], **said: Any) -> Answer:
    words = {"verdict": document["verdict"], **said}
    if "reason_codes" in document:
        words["reasons"] = sorted(document["reason_codes"])
    return {"words": words, "estimates": estimates}


def _pair(mean: float, sigma: float, digits: int = DIGITS) -> list[float]:
    return [float(f"{mean:.{digits}g}"), float(f"{sigma:.{digits}g}")]
