"""Compiles and loads the C++ kernels, once for each machine and version.

The kernels are an option: without a compiler, on another device or with
DRIVETRAIN_NATIVE=0 the same functions run in plain JAX.
"""

import ctypes
import functools
import hashlib
import os
import pathlib
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from importlib import metadata
from typing import Any

import jax
import jax.numpy as jnp

from .. import files

FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-std=c++17", "-fPIC", "-shared")
_SOURCES = sorted(pathlib.Path(__file__).parent.glob("*.cc"))
_HEADERS = sorted(pathlib.Path(__file__).parent.glob("*.h"))


@functools.cache
def load() -> str | None:
    """Makes the kernels known to JAX, compiling them if this machine has not yet.

    Returns:
        None, or a sentence that says why there are none.
    """
    if os.environ.get("DRIVETRAIN_NATIVE") == "0":
        return "DRIVETRAIN_NATIVE is 0"
    compiler = os.environ.get("CXX") or shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        return "no C++ compiler (g++ or clang++) was found"
    try:
        library = ctypes.CDLL(str(_compiled(compiler)))
        for source in _SOURCES:
            for name in _targets(source):
                kernel = jax.ffi.pycapsule(getattr(library, name))
                jax.ffi.register_ffi_target(name, kernel, platform="cpu")
    except (OSError, subprocess.SubprocessError, AttributeError) as error:
        return f"the kernels could not be compiled or loaded ({error})"
    return None


def is_loaded() -> bool:
    """Tells whether the kernels can be called on CPUs."""
    return load() is None


def on_cpu(
    natively: Callable[..., Any], plainly: Callable[..., Any], **static: Any
) -> Callable[..., Any]:
    """Returns the function that takes the kernel on CPUs where there is one.

    Its answers are flags and numbers, so no gradient flows through it.

    Args:
        natively: calls the kernel.
        plainly: does the same in plain JAX, on any device.
        static: what both are given by name besides their operands.
    """

    def ask(*operands: Any) -> Any:
        operands = jax.tree.map(_narrow, jax.lax.stop_gradient(operands))
        if not is_loaded():
            return plainly(*operands, **static)
        return jax.lax.platform_dependent(
            *operands,
            cpu=lambda *operands: _vary_like(operands, natively(*operands, **static)),
            default=functools.partial(plainly, **static),
        )

    return ask


def _narrow(operand: Any) -> Any:
    """Returns numbers of 64 bits in 32, which is what kernels read."""
    narrow = {"int64": jnp.int32, "float64": jnp.float32}
    kind = str(jnp.result_type(operand))
    return jnp.asarray(operand, narrow[kind]) if kind in narrow else operand


def _vary_like(operands: Any, answers: Any) -> Any:
    """Marks answers as differing between devices where an operand does.

    Inside `shard_map` JAX knows that of its own operations, not of foreign kernels.
    """
    axes = frozenset().union(*map(_varying_axes, jax.tree.leaves(operands)))

    def mark(answer: jax.Array) -> jax.Array:
        missing = tuple(axes - _varying_axes(answer))
        return jax.lax.pcast(answer, missing, to="varying") if missing else answer

    return jax.tree.map(mark, answers)


def _varying_axes(array: Any) -> frozenset[str]:
    return jax.typeof(array).manual_axis_type.varying


def _targets(source: pathlib.Path) -> list[str]:
    """Returns the names of the kernels that a source defines."""
    marker = "XLA_FFI_DEFINE_HANDLER_SYMBOL("
    pieces = source.read_text().split(marker)[1:]
    return [piece.split(",")[0].strip() for piece in pieces]


def _compiled(compiler: str) -> pathlib.Path:
    """Returns the library for this machine, from the cache where it is there."""
    version = subprocess.run(
        [compiler, "--version"], check=True, capture_output=True, timeout=60
    )
    digest = hashlib.sha256(version.stdout)
    for part in (*FLAGS, metadata.version("jaxlib"), _processor()):
        digest.update(part.encode())
    for source in (*_SOURCES, *_HEADERS):
        digest.update(source.read_bytes())
    path = files.cache_folder() / "native" / f"{digest.hexdigest()[:16]}.so"
    if not path.exists():
        print("compiling the simulator's kernels, once", file=sys.stderr)
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            built = pathlib.Path(folder) / path.name
            include = ["-isystem", jax.ffi.include_dir()]
            command = [compiler, *FLAGS, *include, *map(str, _SOURCES)]
            subprocess.run(
                [*command, "-o", str(built)],
                check=True,
                capture_output=True,
                timeout=600,
            )
            os.replace(built, path)
    return path


def main() -> None:
    """Compiles the kernels now rather than at first use, and says what came of it."""
    print(f"no kernels: {load()}" if load() else "the simulator's kernels are ready")


def _processor() -> str:
    """Names the instructions that -march=native may use."""
    path = pathlib.Path("/proc/cpuinfo")
    if not path.exists():
        return platform.processor()
    lines = path.read_text().splitlines()
    return next((line for line in lines if line.startswith(("flags", "Features"))), "")


if __name__ == "__main__":
    main()
