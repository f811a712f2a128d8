"""A file that a library reads in a process of its own, with limits on memory, time and reach.

A compiled library may end its process, fill the memory or never come back from a damaged file. In a
child each of these is one line of text. The child may grow by `limits.most_growth` (on Linux;
macOS and Windows know no such limit, there its time alone ends it) and has CHILD_LIFE_S. Before it
opens the file it gives up sockets, further processes and writing: a guard against what a library
does by the way, no jail, since machine code need not ask Python. It answers with arrays of numbers
and texts (.npz without objects), and what it prints is not shown.

Decision: docs/decisions/0087-libraries-in-a-child.md.
"""

import importlib
import json
import os
import signal
import subprocess
import sys
import zipfile
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ins.records import InputError
from ins.user_input import visible
from trajectories.runs.limits import MEGABYTE, OPTION, VARIABLE, most_growth
from trajectories.runs.notes import About, Note, about

CHILD_LIFE_S = 120  # chosen: a gigabyte of packed numbers takes 12
# The rest of the environment may hold what is none of a library's business.
ENVIRONMENT = (
    "PATH",
    "LD_LIBRARY_PATH",
    "DYLD_LIBRARY_PATH",
    "SYSTEMROOT",
    "TMPDIR",
    "TEMP",
    "HDF5_USE_FILE_LOCKING",
)
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
START = (
    "import json, sys; request = json.loads(sys.argv[1]); sys.path[:] = request['search'];"
    f" from {__name__} import Request, answer; answer(Request(**request))"
)
# Audit events (docs.python.org, "Audit events table") that a child has no use for.
REFUSED_EVENTS = (
    "socket.",
    "subprocess.",
    "os.exec",
    "os.fork",
    "os.posix_spawn",
    "os.spawn",
    "os.system",
)
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
# What numpy raises for an answer that is none.
GARBLED = (OSError, EOFError, ValueError, KeyError, TypeError, MemoryError, zipfile.BadZipFile)

Contents = tuple[dict[str, NDArray], list[str]]
"""Arrays by name, and notes on what could not be read."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """What a child is asked: where its modules are, which of them reads, the file, what of it."""

    search: tuple[str, ...]
    module: str
    file: str
    wanted: tuple[str, ...] | None


def read_contained(module: str, path: Path, wanted: Collection[str] | None = None) -> Contents:
    """What `contents(path, wanted)` of a module gives, called in a child.

    Parameters
    ----------
    module : str
        Its full name. It imports its library at once, so that the limits hold for the file alone.
    path : Path
        The file.
    wanted : collection of str, optional
        Names of what is asked for; None is all.

    Returns
    -------
    arrays : dict
        Of numbers or texts.
    notes : list of str
        What could not be read.

    Raises
    ------
    InputError
        As `contents` does, and where the child dies, or needs more memory or time than it may.
    """
    request = Request(
        search=tuple(folder or os.getcwd() for folder in sys.path),
        module=module,
        file=str(path.absolute()),
        wanted=None if wanted is None else tuple(sorted(wanted)),
    )
    with TemporaryFile() as arrays, TemporaryFile() as errors:
        try:
            code = _run(request, arrays, errors)
        except subprocess.TimeoutExpired:
            raise InputError(
                f"{path.name}: not read after {CHILD_LIFE_S} s, needed one that is read within that"
            ) from None
        except OSError as error:
            raise InputError(f"{path.name}: no process to read it in ({error})") from None
        if code:
            raise InputError(f"{path.name}: {_end(code, errors)}, needed a sound file")
        return _loaded(arrays, path.name)


def _run(request: Request, arrays: IO[bytes], errors: IO[bytes]) -> int:
    """A child that answers into a file; its exit code, minus a signal's number."""
    command = [sys.executable, "-I", "-B", "-W", "ignore", "-c", START, json.dumps(asdict(request))]
    kept = {name: os.environ[name] for name in (*ENVIRONMENT, VARIABLE) if name in os.environ}
    ended = subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        stdout=arrays,
        stderr=errors,
        env=kept | ONE_THREAD,
        timeout=CHILD_LIFE_S,
        check=False,
    )
    return ended.returncode


def _end(code: int, errors: IO[bytes]) -> str:
    """Why a child ended: by a signal, or the last line that it wrote."""
    if code < 0:
        return f"the library that reads it ended by {signal.Signals(-code).name}"
    errors.seek(0)
    lines = errors.read(100_000).decode("utf-8", errors="replace").split("\n")
    last = next((line for line in reversed(lines) if line.strip()), "no word")
    return f"the library that reads it ended with {visible(last)[:200]}"


def _loaded(answered: IO[bytes], label: str) -> Contents:
    """The contents that a child wrote; InputError where it refused, or its answer is none."""
    answered.seek(0)
    try:
        with np.load(answered) as stored:
            told = json.loads(str(stored["told"]))
            refused = str(told["refused"])
            arrays = {str(name): stored[f"arr_{k}"] for k, name in enumerate(told["names"])}
            notes = [_note(str(text), code) for text, code in told["notes"]]
    except GARBLED as error:
        why = type(error).__name__
        raise InputError(f"{label}: its reader's answer is garbled ({why})") from None
    if refused:
        raise InputError(refused)
    return arrays, notes


def _note(text: str, code: str | None) -> str:
    return text if code is None else Note(text, About(code))


def answer(request: Request) -> None:
    """In the child: read what was asked for within the limits, and write it where it belongs."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    contents = importlib.import_module(request.module).contents
    path = Path(request.file)
    _limit_itself(most_growth())
    arrays: dict[str, NDArray] = {}
    notes: Iterable[str] = ()
    refused = ""
    try:
        arrays, notes = contents(path, request.wanted)
    except InputError as error:
        refused = str(error)
    except MemoryError:
        most = most_growth() // MEGABYTE
        refused = f"{path.name}: takes more than {most} MB of memory to read, needed at most that"
        refused += f" ({OPTION} raises it)"
    codes = [(str(note), about(note)) for note in notes]
    told = {
        "refused": refused,
        "names": list(arrays),
        "notes": [(text, None if code is None else code.value) for text, code in codes],
    }
    np.savez(out, *arrays.values(), told=np.array(json.dumps(told)))
    out.close()


def _limit_itself(growth_bytes: int) -> None:
    """From here on this process grows by so many bytes at most, and neither writes nor calls."""
    sys.addaudithook(_guard)
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return
    most = {resource.RLIMIT_CPU: CHILD_LIFE_S, resource.RLIMIT_FSIZE: growth_bytes}
    most[resource.RLIMIT_CORE] = 0
    pages = Path("/proc/self/statm")
    if pages.exists():
        used = int(pages.read_text().split()[0]) * resource.getpagesize()
        most[resource.RLIMIT_AS] = used + growth_bytes
    for kind, value in most.items():
        hard = resource.getrlimit(kind)[1]
        least = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(kind, (least, least))


def _guard(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuses sockets, processes, and files that are opened for writing."""
    writes = event == "open" and bool((arguments[2] or 0) & WRITING)
    if writes or event.startswith(REFUSED_EVENTS):
        raise PermissionError(f"{event} while a file is read")
