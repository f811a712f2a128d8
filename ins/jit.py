"""`jit`: the decorator of every compiled kernel. Import lazily: this module loads numba.

Without numba, or with NUMBA_DISABLE_JIT=1, a kernel runs as plain Python, slowly.

Compiled code is kept in a folder named by a hash of all sources of `ins` and of the kernel's own
top-level package, inner packages included, because numba itself looks at one file only and would go
on using a kernel whose constants or callees changed elsewhere. So a kernel may call others and take
constants across the modules of these two, and of no third package. The folder lies in the first
place that can be written: NUMBA_CACHE_DIR, the user's cache folder, __pycache__ beside this file,
the user's own folder under the temporary one. With none of them a kernel is compiled anew in each
process.

Decision: docs/decisions/0083-compiled-kernels.md.
"""

import contextlib
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

try:
    import numba
except ImportError:  # the plain-Python path
    numba = None  # type: ignore[assignment]

# no_cfunc_wrapper: nobody hands a kernel on as a C function; without it 7 % less to compile.
# error_model: a division by zero gives inf or NaN as in numpy, and the filters refuse what is not
# finite; a test of each division is a fifth of what there is to compile.
JIT_OPTIONS = {"nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
# a full disk would fail in the middle of a write; KEPT_FOLDERS of 1 MB, and room
NEEDED_BYTES = 50_000_000
KEPT_FOLDERS = 20  # compiled code of older sources, about 1 MB each


def jit(function: Callable | None = None, **options: Any) -> Any:
    """Compile a kernel on its first call and keep the machine code on disk.

    `@jit` or `@jit(forceinline=True)`. Kernels release the interpreter's lock and divide by zero
    as numpy does, unless told otherwise.

    Parameters
    ----------
    function : callable, optional
        The kernel; None where options are given.
    **options
        Options of numba.njit.

    Returns
    -------
    kernel : callable
        Compiled. Without numba, or with NUMBA_DISABLE_JIT=1, the function itself.
    """
    if function is None:
        return lambda decorated: jit(decorated, **options)
    config: Any = getattr(numba, "config", None)
    if config is None or config.DISABLE_JIT:
        return function
    options = {**JIT_OPTIONS, **options}
    if options.get("no_cpython_wrapper"):
        return numba.njit(**options)(function)  # there is nothing of it to keep
    source = Path(function.__code__.co_filename)
    # None: in a zip, or a .pyc alone
    folder = cache_folder(source.parent) if source.is_file() else None
    if folder is not None:
        given, config.CACHE_DIR = config.CACHE_DIR, str(folder)  # read once, by njit(cache=True)
        try:
            compiled = numba.njit(cache=True, **options)(function)
            # numba goes elsewhere if the folder has gone
            if Path(compiled.stats.cache_path).is_relative_to(folder):
                return compiled
        except (RuntimeError, OSError):
            pass
        finally:
            config.CACHE_DIR = given
    return numba.njit(**options)(function)


def entry(inner: Callable) -> Any:
    """A way in from Python to a kernel that only kernels call, compiled when it is used.

    Parameters
    ----------
    inner : callable
        Made by `jit`.

    Returns
    -------
    kernel : callable
        The same function, compiled by itself.
    """
    return jit(getattr(inner, "py_func", inner))


@cache
def cache_folder(sources: Path) -> Path | None:
    """Where the compiled code of the kernels in a folder is kept; it is made if need be.

    Parameters
    ----------
    sources : Path
        The folder of the kernel's module.

    Returns
    -------
    folder : Path or None
        Named by `source_hash`; None where nothing can be written.
    """
    name = f"kernels-{source_hash(Path(__file__).parent, top_package(sources))}"
    for parent in _parents():
        folder = parent / name
        try:
            new = not folder.is_dir()
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            os.utime(folder)
            if shutil.disk_usage(folder).free < NEEDED_BYTES:
                continue
        except OSError:
            continue
        if new:
            _remove_old(parent)
        return folder
    return None


class Stopwatch:
    """Seconds that this process has spent on compiling kernels since the watch began.

    Parameters
    ----------
    began : callable
        Called once, when the first kernel is about to be compiled.
    """

    def __init__(self, began: Callable[[], None]) -> None:
        self.seconds = 0.0
        self._began = began
        self._depth, self._since = 0, 0.0

    def start(self) -> None:
        """A kernel is about to be compiled, or one that it calls."""
        if self._depth == 0:
            self._since = time.monotonic()
            if self.seconds == 0.0:
                self._began()
        self._depth += 1

    def stop(self) -> None:
        """A kernel has been compiled."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.monotonic() - self._since


def watch_compiling(began: Callable[[], None]) -> Stopwatch:
    """Count the seconds that this process compiles; kernels read from the disk do not count.

    Parameters
    ----------
    began : callable
        Called once, when the first kernel is about to be compiled.

    Returns
    -------
    watch : Stopwatch
        Without numba it stays at zero.
    """
    watch = Stopwatch(began)
    if numba is not None:
        from numba.core import event

        class Ends(event.Listener):
            """What numba calls at either end of a compilation."""

            def on_start(self, event: Any) -> None:
                watch.start()

            def on_end(self, event: Any) -> None:
                watch.stop()

        event.register("numba:compile", Ends())
    return watch


def top_package(folder: Path) -> Path:
    """The folder of the top-level package that a folder lies in.

    Parameters
    ----------
    folder : Path
        A package at any depth.

    Returns
    -------
    package : Path
        `folder` itself where it is not inside a package.
    """
    while (folder.parent / "__init__.py").is_file():
        folder = folder.parent
    return folder


def source_hash(*folders: Path) -> str:
    """Hash over the Python files in and below some folders: their paths and bytes.

    Parameters
    ----------
    *folders : Path
        Given twice, a folder counts once.

    Returns
    -------
    digits : str
        16 hexadecimal digits.
    """
    digest = hashlib.sha256()
    for folder in sorted(set(folders)):
        for path in sorted(folder.rglob("*.py")):
            source = path.read_bytes()
            name = path.relative_to(folder.parent).as_posix()
            digest.update(f"{name} {len(source)}\n".encode() + source)
    return digest.hexdigest()[:16]


def _parents() -> Iterator[Path]:
    """Places to try, best first. Beside the package last but one: what is put there outlives `pip
    uninstall`.
    """
    if os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(os.environ["NUMBA_CACHE_DIR"]).absolute() / "recal"
    try:
        from platformdirs import user_cache_path

        yield user_cache_path("recal", appauthor=False)
    except (ImportError, OSError, RuntimeError, KeyError):  # no home, no such user
        pass
    yield Path(__file__).parent / "__pycache__"
    if (own := _own_temporary_folder()) is not None:
        yield own


def _own_temporary_folder() -> Path | None:
    """A folder under the temporary one that only this user can write: what lies in it will be run
    as code.
    """
    if not hasattr(os, "getuid"):
        return None
    try:
        folder = Path(tempfile.gettempdir()) / f"recal-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return None
    private = (
        status.st_uid == os.getuid()
        and status.st_mode & 0o077 == 0
        and folder.is_dir()
        and not folder.is_symlink()
    )
    return folder if private else None


def _remove_old(parent: Path) -> None:
    """Forget the compiled code of all but the latest sources."""
    with contextlib.suppress(OSError):  # another process does the same
        folders = [f for f in parent.glob("kernels-*") if f.is_dir() and not f.is_symlink()]
        for folder in sorted(folders, key=lambda f: f.stat().st_mtime, reverse=True)[KEPT_FOLDERS:]:
            shutil.rmtree(folder, ignore_errors=True)
