"""Writing results: a directory made on demand, each file whole or not at all."""

import errno
import os
import tempfile
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from os import PathLike
from pathlib import Path

from ins.records import InputError

AnyPath = str | PathLike[str]


def program_version() -> str:
    """Version of the installed distribution."""
    try:
        return version("strapdown-recal")
    except PackageNotFoundError:
        return "not installed"


def output_directory(path: Path | None, command: str) -> Path:
    """The output directory, created; default recal-COMMAND."""
    directory = path if path is not None else Path(f"recal-{command}")
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{directory}: cannot be made ({error.strerror})") from None
    return directory


def write_text(path: Path, text: str) -> Path:
    """Write one file, whole or not at all; InputError where it cannot be written."""
    write_files({path: text})
    return path


def write_files(texts: dict[Path, str], *, commit: Callable[[], object] = lambda: None) -> None:
    """Write every file to a temporary sibling, call `commit`, then rename: a reader never sees half
    a file.

    InputError where one cannot be written, and then `commit` was not called; where `commit` raises,
    no file changed.
    """
    staged: dict[Path, str] = {}
    path = Path()
    try:
        for path, text in texts.items():
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            if path.exists() and not path.is_file():  # would be replaced by a file
                raise OSError(errno.EINVAL, "a pipe or device, needed a regular file")
            handle, staged[path] = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                stream.write(text)
            os.chmod(staged[path], 0o644)
        commit()
        for path in texts:
            os.replace(staged[path], path)
            del staged[path]
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    finally:
        for name in staged.values():
            Path(name).unlink(missing_ok=True)


def watch_compiling(began: Callable[[], None]) -> Callable[[], float]:
    """What gives the seconds that this process has compiled for since; `began` is called when it
    starts to.
    """
    from ins import jit

    watch = jit.watch_compiling(began)
    return lambda: watch.seconds
