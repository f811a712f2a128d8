"""What was found, in words: the verdict's sentence, and the three answers that a reader looks for
first: where the gap lies, which effect makes it, how far it shrinks and what that is worth.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from infield.reports.page import duration, number
from ins.errors.base import SLOW_NAME
from ins.errors.table import TABLE_AGED
from simreal.inference.addback import Shrink
from simreal.inference.causes import Answer, Cause
from simreal.inference.diagnosis import Diagnosis
from simreal.inference.places import Place
from simreal.inference.verdict import GapVerdict, Looks
from simreal.predict.sessions import Expected, SessionDrift

HEADS = {
    GapVerdict.EXPLAINED: "Explained by",
    GapVerdict.PARTLY_EXPLAINED: "Partly explained by",
    GapVerdict.UNEXPLAINED: "Not explained by a named effect:",
}
LOOK_WORDS = {
    Looks.CELLS: "the mean square of a channel's band",
    Looks.TEMPERATURE_BANDS: "means over bands of temperature",
    Looks.TIME_WINDOWS: "means over ten-minute windows",
    Looks.BURST: "single large residuals",
    Looks.KURTOSIS: "tails that are not normal",
    Looks.CROSS_CHANNEL: "correlation across channels",
}
# causes and rivals in a sentence; chosen: 3 and 4 fill three lines, and the document lists all
MOST_CAUSES_SAID, MOST_RIVALS_SAID = 3, 4
# an upper end beyond has no name but "quicker"; chosen: half the rate of a slow log is 5 Hz
QUICKEST_HZ = 100.0


@dataclass(frozen=True)
class Found:
    """Causes of one name on one target: one, or an event of several runs."""

    causes: tuple[Cause, ...]

    @property
    def first(self) -> Cause:
        return self.causes[0]

    @property
    def words(self) -> str:
        """The effect and its target, with the number of its runs where it is an event of
        several.
        """
        c = self.first
        if c.effect == SLOW_NAME:
            return f"a slow variation on {plain(c.target)}, tied to no logged quantity"
        article = "" if c.named else "an "
        many = f" in {len(self.causes)} runs" if len(self.causes) > 1 else ""
        return f"{article}{plain(c.effect)} on {plain(c.target)}{many}"


def gathered(causes: Iterable[Cause]) -> list[Found]:
    """Causes by name and target, in their order."""
    by: dict[tuple[str, str], list[Cause]] = {}
    for cause in causes:
        by.setdefault((cause.effect, cause.target), []).append(cause)
    return [Found(tuple(same)) for same in by.values()]


def plain(name: str) -> str:
    """A name of a document, as it is read."""
    return name.replace("_", " ")


def listed(words: Sequence[str], last: str = "and") -> str:
    """Words in a row, the last after `last`."""
    return f" {last} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def verdict_sentence(diagnosis: Diagnosis, *, with_table: bool = True) -> str:
    """The verdict in one sentence, or in two where the table has aged or there is none."""
    verdict, causes, where = diagnosis.verdict, diagnosis.causes, diagnosis.where
    looks_like = diagnosis.unexplained.looks_like
    if verdict is GapVerdict.NO_GAP:
        return "No gap beyond the noise floor."
    if not causes:
        at = f", mostly in {plain(where[0].channel)}" if where else ""
        return f"A gap that no known effect explains{at}: it shows in {LOOK_WORDS[looks_like]}."
    aged = [_aged_by(c) for c in causes if c.effect == TABLE_AGED]
    said = [_said(f) for f in gathered(c for c in causes if c.effect != TABLE_AGED)]
    sentences = []
    if aged and with_table:
        sentences.append(f"The table has aged ({listed(sorted(aged))}): renew it.")
    elif aged:
        sentences.append(f"No table was given, and an update would learn {listed(sorted(aged))}.")
    if said:
        more = [f"{len(said) - MOST_CAUSES_SAID} more"] if len(said) > MOST_CAUSES_SAID else []
        sentences.append(f"{HEADS[verdict]} {'; '.join([*said[:MOST_CAUSES_SAID], *more])}.")
    if verdict is GapVerdict.PARTLY_EXPLAINED and looks_like is not Looks.NOTHING:
        sentences.append("Something is left.")
    return " ".join(sentences)


def _aged_by(cause: Cause) -> str:
    """A gyro, and by how much its table has aged."""
    shift = cause.parameters.get("shift")
    by = f" by {shift.value:.2g} {shift.unit}" if shift else ""
    return f"{plain(cause.target)}{by}"


def _said(found: Found) -> str:
    """Causes, with what they cannot be told from."""
    if found.first.resolved or not found.first.rivals:
        return found.words
    return f"{found.words} (not unique: or {rivals_words(found.first)})"


def rivals_words(cause: Cause) -> str:
    """Other answers of the set, with their targets where these are others."""
    names = list(dict.fromkeys(answer_words(r, cause.target) for r in cause.rivals))
    more = len(names) - MOST_RIVALS_SAID
    said = names[:MOST_RIVALS_SAID] + ([f"{more} more"] if more > 0 else [])
    return listed(said, "or")


def answer_words(answer: Answer, target: str = "") -> str:
    """An answer with its target, where that is another one."""
    if not answer.target:
        return "outside the catalogue"
    at = "" if answer.target == target else f" on {plain(answer.target)}"
    return f"{plain(answer.effect)}{at}"


def place_words(place: Place, longest_s: float) -> str:
    """Time, temperature and frequency of a place; longest_s: of the runs' rests."""
    start, end = (f"{t / 60:.0f}" for t in place.time_s)
    words = [f"minutes {start} to {end}"]
    if place.temperature_degC is not None:
        low, high = place.temperature_degC
        words.append(f"{number(low, 0)} to {number(high, 0)} °C")
    words.append(f"periods {band_words(*place.frequency_hz, longest_s)}")
    return ", ".join(words)


def band_words(low_hz: float, high_hz: float | None, longest_s: float) -> str:
    """A band of frequencies as periods, none longer than the longest rest."""
    slow = low_hz <= 0.0 or 1.0 / low_hz > longest_s
    quick = high_hz is None or high_hz > QUICKEST_HZ
    if slow and quick:
        return "of all lengths"
    if quick or high_hz is None:
        return f"under {period(1.0 / low_hz)}"
    if not slow:
        return f"{period(1.0 / high_hz)} to {period(1.0 / low_hz)}"
    if 1.0 / high_hz > longest_s:
        return "trend" if low_hz > 0.0 else "mean"
    return f"over {period(1.0 / high_hz)}"


def period(seconds: float) -> str:
    """In seconds below 100 s, in minutes below 90."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def percent(fraction: float) -> str:
    """A share in whole percents."""
    return f"{100 * fraction:.0f} %".replace("-", "−")


def shrink_words(shrink: Shrink) -> str:
    """Its interval, and the data that it was measured on."""
    low, high = shrink.interval_95
    data = f"held out, {shrink.how}" if shrink.held_out else f"{shrink.how}, not held out"
    small = "; too small there to quantify" if shrink.too_small else ""
    return f"{percent(low)} to {percent(high)}; {data}{small}"


def drift_words(drift: SessionDrift) -> str:
    """What a session's drift is with the effects and without them."""
    return (
        f"Drift of a session like these, after {duration(drift.align_s)} of alignment and on any"
        f" heading: {expected(drift.as_it_is)} NM/h as it is, {expected(drift.without)} without"
        " what was found (RMS over sessions, 95 %)."
    )


def expected(value: Expected) -> str:
    """A number of NM/h with its interval."""
    low, high = value.interval_95
    return f"{number(value.rms_nm_h)} ({number(low)} to {number(high)})"
