"""The journal of a fleet update: what is done, one JSON object a line, on the disk before the next
task is handed out.

Only the parent writes it. A kill leaves at most one cut line, at the end: it is dropped, and what
it told is found out anew (the store knows which runs it holds). Lines of a call with another store
or other settings count for nothing in this one.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

from ins.records import InputError
from recal.fleet.records import RunOutcome, outcome_from_json

NAME = "journal.jsonl"


class Journal:
    """Open for one parent at a time. runs: outcomes by path; units: summaries by unit; both of
    earlier calls like this one.

    heads: number of each unit's active revision before the first of these calls; a unit that is not
    there had no table.
    """

    def __init__(self, folder: Path, settings: dict[str, Any], heads: Mapping[str, int]) -> None:
        self.path = folder / NAME
        self.call = hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:16]
        self.runs: dict[str, RunOutcome] = {}
        self.units: dict[str, dict[str, Any]] = {}
        self.calls: list[dict[str, Any]] = []
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
        self.heads: dict[str, int] = self.calls[0]["heads"] if self.calls else dict(heads)
        self._append({"event": "call", "utc": now, "settings": settings, "heads": dict(heads)})

    def add_run(self, outcome: RunOutcome) -> None:
        self.runs[outcome.path] = outcome
        self._append({"event": "run", "run": outcome.to_json()})

    def add_unit(self, name: str, summary: dict[str, Any]) -> None:
        self.units[name] = summary
        self._append({"event": "unit", "unit": name, "summary": summary})

    def end(self, timing: dict[str, Any]) -> None:
        """The call is through, or was stopped."""
        self._append({"event": "end", "timing": timing})

    def close(self) -> None:
        self._stream.close()

    def _append(self, line: dict[str, Any]) -> None:
        try:
            self._stream.write((json.dumps({**line, "call": self.call}) + "\n").encode())
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
                    self._take(line)
            except (ValueError, KeyError, TypeError):
                raise InputError(
                    f"{self.path}: line {number} is damaged; move the file away to begin anew"
                ) from None

    def _take(self, line: dict[str, Any]) -> None:
        if line["event"] == "call":
            self.calls.append({"utc": line["utc"], "heads": line["heads"]})
        elif line["event"] == "run":
            outcome = outcome_from_json(line["run"])
            self.runs[outcome.path] = outcome
        elif line["event"] == "unit":
            self.units[line["unit"]] = line["summary"]
        elif line["event"] == "end":
            self.calls[-1]["timing"] = line["timing"]


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
