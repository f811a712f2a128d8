"""Kernels compiled with less work do what numba's own compiler makes of them, to the last bit."""

import gc
import subprocess
import sys

import numba
import numpy as np
import pytest
from numba.core import typed_passes, types, untyped_passes

from ins.compiler.pipeline import OMITTED, KernelCompiler
from ins.filters import error_kernel as fk
from ins.jit import entry, jit

DEPTH = 40  # steps of a sum whose order shows in its last bits
# of the caller alone, the function that only kernels call is machine code where it is called
BY_ITSELF = """
from numba.core import codegen
made, finish = [], codegen.JITCodeLibrary._finalize_specific
codegen.JITCodeLibrary._finalize_specific = lambda self: (made.append(self.name), finish(self))
from ins.jit import jit
inner = jit(no_cpython_wrapper=True)(lambda x: x + 1.0)
middle = jit(no_cpython_wrapper=True)(lambda x: 2.0 * inner(x))
outer = jit(lambda x: middle(x) + inner(x))
assert outer(1.0) == 6.0
print(len(made))
"""


def summed(x, out):
    """Products, roots, powers and divisions in an order that rounding shows."""
    total = 0.0
    for k in range(x.size):
        total += np.sqrt(x[k] * x[k] + total) / (1.0 + k) - x[k] ** 3
        out[k, :] = total
        out[k, k % 2] -= x[k] // 0.25
    return total, min(total, x[0])


def test_the_bits_are_those_of_numbas_own_compiler():
    x = np.random.default_rng(5).standard_normal(DEPTH)
    own, plain = np.zeros((DEPTH, 2)), np.zeros((DEPTH, 2))
    kernel = jit(summed)
    assert kernel.targetoptions["error_model"] == "numpy"
    alone = numba.njit(error_model="numpy")(summed)
    assert kernel(x, own) == alone(x, plain)
    assert own.tobytes() == plain.tobytes()
    assert kernel._compiler.pipeline_class is KernelCompiler


def test_what_a_step_does_is_the_same_to_the_last_bit_under_both_compilers():
    """The transition of the error filter, with all that it calls."""
    parts = {n for n, k in vars(fk).items() if hasattr(k, "py_func")}
    rng = np.random.default_rng(7)
    step = rng.standard_normal(fk.STEP_COLUMNS)
    step[[fk.DT, fk.RADIUS, fk.GRAVITY]] = 0.5, 6.4e6, 9.8
    noise, flags = np.abs(rng.standard_normal(6)), np.array([1, 1, 0, 0], dtype=np.int64)

    def filled(compiled):
        rooms = [np.zeros((fk.CORE, fk.CORE)) for _ in range(5)]
        q, Q = np.zeros((fk.NOISY, fk.NOISY)), np.zeros((fk.NOISY, fk.NOISY))
        compiled(step, flags, noise, *rooms, q, Q)
        return rooms[4].tobytes() + Q.tobytes()

    def plain(name):
        function = getattr(fk, name).py_func
        inside = {n: plain(n) for n in function.__code__.co_names if n in parts}
        own = type(function)(function.__code__, {**vars(fk), **inside}, function.__name__)
        return numba.njit(error_model="numpy")(own)

    assert filled(entry(fk.transition)) == filled(plain("transition"))


def test_a_function_that_only_kernels_call_is_made_machine_code_once():
    done = subprocess.run(
        [sys.executable, "-c", BY_ITSELF], capture_output=True, text=True, check=True
    )
    # numba makes its runtime's library beside the one kernel
    assert int(done.stdout) <= 2


def test_numba_is_left_as_it_was():
    before = types.functions.BaseFunction.get_call_type
    assert jit(lambda x: x + 1.0)(1.0) == 2.0
    with pytest.raises(numba.TypingError):
        jit(lambda x: x.no_such_thing)(1.0)
    assert types.functions.BaseFunction.get_call_type is before
    assert gc.isenabled()


def test_every_pass_left_out_is_one_of_numbas():
    """A pass with another name in a later numba would be run again, and cost its time."""
    known = {*vars(typed_passes), *vars(untyped_passes)}
    assert known >= OMITTED
