"""Tells when kernels are compiled; loads numba where it is asked."""

from collections.abc import Callable


def watch_compiling(began: Callable[[], None]) -> Callable[[], float]:
    """What gives the seconds that this process has compiled for since; `began` is called when it
    starts to.
    """
    from ins import jit

    watch = jit.watch_compiling(began)
    return lambda: watch.seconds
