"""How numba compiles the kernels, behind `ins.jit`: the same code with less work."""
