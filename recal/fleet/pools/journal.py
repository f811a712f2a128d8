"""The journal of a fleet update: what is done, one JSON object a line, on the disk before the next
task is handed out.

Only the parent writes it. A kill leaves at most one cut line, at the end: it is dropped, and what
it told is found out anew (the store knows which runs it holds). Lines of a call with another store
or other settings count for nothing in this one.

Decision: docs/decisions/0022-sqlite-journal.md.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import BinaryIO

from ins.documents import from_json, plain
from ins.records import InputError
from recal.fleet.records import CallSettings, CallTiming, EarlierCall, RunOutcome, UnitReport

NAME = "journal.jsonl"


class Event(StrEnum):
    """What a line tells of."""

    CALL = "call"
    RUN = "run"
    UNIT = "unit"
    END = "end"


@dataclass(frozen=True, kw_only=True)
class _Line:
    """A line of the file; a call has heads, a run its outcome, a unit its summary, an end its
    timing.
    """

    event: Event
    call: str
    utc: str = ""
    heads: Mapping[str, int] = field(default_factory=dict)
    run: RunOutcome | None = None
    unit: str = ""
    summary: UnitReport | None = None
    timing: CallTiming | None = None


class Journal:
    """Open for one parent at a time. runs: outcomes by path; units: summaries by unit; both of
    earlier calls like this one.

    heads: number of each unit's active revision before the first of these calls; a unit that is not
    there had no table.
    """

    def __init__(self, folder: Path, settings: CallSettings, heads: Mapping[str, int]) -> None:
        self.path = folder / NAME
        said = plain(settings)
        self.call = hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()[:16]
        self.runs: dict[str, RunOutcome] = {}
        self.units: dict[str, UnitReport] = {}
        self.calls: list[EarlierCall] = []
        try:
            self._stream: BinaryIO = open(self.path, "ab+")
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror})") from None
        _lock(self._stream, folder)
        try:
            self._read()
        except InputError:
            self.close()
            raise
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        self.heads: Mapping[str, int] = self.calls[0].heads if self.calls else dict(heads)
        self._append(Event.CALL, utc=now, settings=said, heads=dict(heads))

    def add_run(self, outcome: RunOutcome) -> None:
        self.runs[outcome.path] = outcome
        self._append(Event.RUN, run=plain(outcome))

    def add_unit(self, name: str, summary: UnitReport) -> None:
        self.units[name] = summary
        self._append(Event.UNIT, unit=name, summary=plain(summary))

    def end(self, timing: CallTiming) -> None:
        """The call is through, or was stopped."""
        self._append(Event.END, timing=plain(timing))

    def close(self) -> None:
        self._stream.close()

    def _append(self, event: Event, **what: object) -> None:
        line = json.dumps({"event": event, **what, "call": self.call}) + "\n"
        try:
            self._stream.write(line.encode())
            self._stream.flush()
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror})") from None

    def _read(self) -> None:
        self._stream.seek(0)
        data = self._stream.read()
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):
            self._stream.truncate(len(whole))
        for number, text in enumerate(whole.splitlines(), 1):
            try:
                line = json.loads(text)
                if line["call"] == self.call:
                    self._take(from_json(_Line, line, name=str(self.path)))
            except (ValueError, KeyError, TypeError):
                raise InputError(
                    f"{self.path}: line {number} is damaged; move the file away to begin anew"
                ) from None

    def _take(self, line: "_Line") -> None:
        if line.event is Event.CALL:
            self.calls.append(EarlierCall(utc=line.utc, heads=line.heads))
        elif line.event is Event.END:
            self.calls[-1] = replace(self.calls[-1], timing=line.timing)
        elif line.run is not None:
            self.runs[line.run.path] = line.run
        elif line.summary is not None:
            self.units[line.unit] = line.summary


def _lock(stream: BinaryIO, folder: Path) -> None:
    """One parent at a time in an output folder; the lock goes with the process, however it ends."""
    try:
        import fcntl
    except ImportError:  # no such locks on this system
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        stream.close()
        raise InputError(f"{folder}: another recal fleet update is at work there") from None
