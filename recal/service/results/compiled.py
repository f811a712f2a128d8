"""Tells when kernels are compiled; loads numba where it is asked."""

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ins import jit


def watch_compiling(began: Callable[[], None]) -> "jit.Stopwatch":
    """The seconds that this process compiles; `began` is called when it starts to."""
    from ins import jit

    return jit.watch_compiling(began)
