"""A first-order recursion over many samples. Import lazily: this module loads numba."""

from ins.jit import jit


@jit
def add_kept(real, imaginary, keep_real, keep_imaginary):
    """y[k] = keep y[k - 1] + y[k], in place; real and imaginary parts (n,), keep below 1 in size.

    To the last bit what complex numbers of Python give.
    """
    for k in range(1, real.size):
        re, im = real[k - 1], imaginary[k - 1]
        real[k] += keep_real * re - keep_imaginary * im
        imaginary[k] += keep_real * im + keep_imaginary * re
