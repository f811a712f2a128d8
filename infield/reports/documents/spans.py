"""Stretches of time that were left out, as every document lists them."""

from dataclasses import dataclass, field

from ins.documents import OMIT_NONE
from ins.records import Span
from ins.verdicts import LeftOut, Reason, sentence


@dataclass(frozen=True)
class SpanDocument:
    """A stretch of time and why it was left out; run_id: where several runs share the list."""

    start_s: float
    end_s: float
    reason: str
    run_id: str | None = field(default=None, metadata=OMIT_NONE)


def span_document(span: Span | LeftOut, run_id: str | None = None) -> SpanDocument:
    """The stretch with its reason in words."""
    reason = span.reason
    words = sentence(reason) if isinstance(reason, Reason) else str(reason)
    return SpanDocument(span.start_s, span.end_s, words, run_id)
