"""Diagnosis reports below one directory, and nothing outside it: whatever a path says, and wherever
a link points.
"""

import json
import os
import stat
from dataclasses import dataclass
from pathlib import Path

from fastapi.staticfiles import StaticFiles

from ins.records import InputError
from recal.service.results.pages import JsonObject

DOCUMENT, PAGE = "diagnosis.json", "diagnosis.html"
LARGEST = 32 * 2**20  # 32 MB of a report (docs/serve.md)
# folders that are looked through, 0.2 s of a walk at most, and how deep; chosen: runs and
# diagnoses lie 2 or 3 deep
MOST_DIRECTORIES, DEEPEST = 5000, 8


@dataclass(frozen=True)
class DiagnosisEntry:
    """A diagnosis.json: its folder relative to the root, the document (empty where it cannot be
    read), and why.
    """

    folder: str
    document: JsonObject
    fault: str
    has_page: bool

    @property
    def title(self) -> str:
        """The folder in words: that of the reports itself has no name of its own."""
        return "top folder" if self.folder == "." else self.folder


class Reports:
    """The files under `root`. None: no directory was given, and nothing is found."""

    def __init__(self, root: Path | None) -> None:
        if root is not None and not root.is_dir():
            raise InputError(f"{root}: no such directory, needed one with diagnosis reports")
        self._root = None if root is None else root.resolve()

    @property
    def given(self) -> bool:
        return self._root is not None

    def all(self) -> list[DiagnosisEntry]:
        """Every diagnosis.json, by folder; of a large tree the first MOST_DIRECTORIES folders."""
        return [self._entry(folder) for folder in self._folders()]

    def one(self, folder: str) -> DiagnosisEntry | None:
        """The diagnosis in a folder, None where there is none (inside the root)."""
        return self._entry(folder) if self._inside(folder, DOCUMENT) else None

    def text(self, folder: str, name: str) -> str | None:
        """The text of diagnosis.json or diagnosis.html, None where there is none; InputError where
        it cannot be read.
        """
        path = self._inside(folder, name) if name in (DOCUMENT, PAGE) else None
        if path is None:
            return None
        try:
            with os.fdopen(
                os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb"
            ) as stream:
                about = os.fstat(stream.fileno())
                if not stat.S_ISREG(about.st_mode) or about.st_size > LARGEST:
                    raise InputError(
                        f"{name}: {about.st_size} bytes, needed a file of at most {LARGEST}"
                    )
                return stream.read(LARGEST).decode("utf-8")
        except OSError as error:
            raise InputError(f"{name}: cannot be read ({error.strerror})") from None
        except UnicodeDecodeError:
            raise InputError(f"{name}: not UTF-8 text") from None

    def _inside(self, folder: str, name: str) -> Path | None:
        """The real path of a file in a folder under the root; None where it is not there or leads
        out.
        """
        if self._root is None:
            return None
        try:
            path, about = StaticFiles(directory=self._root).lookup_path(f"{folder}/{name}")
        except (OSError, ValueError):
            return None
        return Path(path) if about is not None and stat.S_ISREG(about.st_mode) else None

    def _folders(self) -> list[str]:
        found: list[str] = []
        if self._root is None:
            return found
        for count, (folder, below, names) in enumerate(os.walk(self._root)):
            relative = Path(folder).relative_to(self._root)
            if count >= MOST_DIRECTORIES or len(relative.parts) >= DEEPEST:
                below.clear()
            below[:] = sorted(name for name in below if not name.startswith("."))
            if DOCUMENT in names and self._inside(str(relative), DOCUMENT):
                found.append(relative.as_posix())
        return sorted(found)

    def _entry(self, folder: str) -> DiagnosisEntry:
        document, fault = {}, ""
        try:
            document = json.loads(self.text(folder, DOCUMENT) or "")
            if not isinstance(document, dict) or document.get("schema") != "recal.diagnosis/1":
                document, fault = {}, "not a document of schema recal.diagnosis/1"
        except (InputError, ValueError, RecursionError) as error:
            fault = str(error) if isinstance(error, InputError) else "not JSON"
        return DiagnosisEntry(folder, document, fault, self._inside(folder, PAGE) is not None)
