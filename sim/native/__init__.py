"""C++ kernels for CPUs, compiled at first use where a compiler is there."""
