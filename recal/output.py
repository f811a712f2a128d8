"""Writing results: a directory made on demand, each file whole or not at all."""

import os
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ins.records import InputError


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
        raise InputError(f"{directory}: cannot be made: {error.strerror}") from None
    return directory


def write_text(path: Path, text: str) -> Path:
    """Write through a temporary sibling and rename, so that a reader never sees half a file."""
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        os.chmod(name, 0o644)
        os.replace(name, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    return path
