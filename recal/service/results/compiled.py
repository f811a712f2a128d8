"""Whether the kernels are compiled yet; loads numba where it is asked."""


def is_compiled() -> bool:
    """False where this machine compiles on the next call of a kernel."""
    from ins import jit

    return jit.is_compiled()
