"""Times compiled programs: compilation apart, and the median of many calls."""

import contextlib
import dataclasses
import gc
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.compilation_cache import compilation_cache
from jaxtyping import Array, Key, PRNGKeyArray, PyTree

Step = Callable[[PyTree, PRNGKeyArray], tuple[PyTree, PyTree]]

MIN_CALLS = 5  # quartiles of fewer mean nothing


@dataclasses.dataclass(frozen=True, kw_only=True)
class Program:
    """A compiled function, and what it needs."""

    call: Callable[..., PyTree]
    compile_s: float  # to trace, lower and compile
    memory_mb: float  # arguments, the bank among them, results and temporaries


@dataclasses.dataclass(frozen=True, kw_only=True)
class Timing:
    """How long the calls of a program took [ms]."""

    median: float
    lower: float  # quartile
    upper: float  # quartile


def compile(function: Callable[..., PyTree], arguments: tuple[Any, ...]) -> Program:
    """Compiles a function of arrays for the shapes of some arguments.

    The memory is what XLA assigned to the program.
    """
    began = time.perf_counter()
    compiled = jax.jit(function).lower(*arguments).compile()
    compile_s = time.perf_counter() - began
    memory: Any = compiled.memory_analysis()  # None on no backend that we know
    num_bytes = (
        memory.argument_size_in_bytes
        + memory.output_size_in_bytes
        + memory.temp_size_in_bytes
    )
    return Program(call=compiled, compile_s=compile_s, memory_mb=num_bytes / 1e6)


def measure(
    program: Program, inputs: Sequence[tuple[Any, ...]], seconds: float
) -> Timing:
    """Times calls of a program until their results are there.

    Each input is used once before the clock starts; then the calls go round the inputs,
    at least `MIN_CALLS` times and until the time is spent. Whatever varies is an
    argument of the program and whatever it computes a result, so that XLA can leave
    nothing out and compute nothing beforehand.

    Args:
        program: to call.
        inputs: arguments of equal shapes and different values, at least one.
        seconds: how long to go on, the first calls not counted.
    """
    for arguments in inputs:
        jax.block_until_ready(program.call(*arguments))
    durations: list[float] = []
    with _no_collection():
        while len(durations) < MIN_CALLS or sum(durations) < seconds:
            arguments = inputs[len(durations) % len(inputs)]
            began = time.perf_counter()
            jax.block_until_ready(program.call(*arguments))
            durations.append(time.perf_counter() - began)
    lower, median, upper = np.percentile(durations, (25, 50, 75)) * 1e3
    return Timing(median=float(median), lower=float(lower), upper=float(upper))


def play(step: Step, state: PyTree, keys: Key[Array, " steps"]) -> PyTree:
    """Plays steps in a program, each of which writes over what the last one gave.

    A policy reads an observation and forgets it; to keep those of all steps would time
    the memory instead.

    Args:
        step: of a state and a key: the next state, and what it gives.
        state: the first.
        keys: one for each step.

    Returns:
        The last state, and what the last step gave.
    """

    def go_on(carry: PyTree, key: PRNGKeyArray) -> tuple[PyTree, None]:
        return step(carry[0], key), None

    blank = jax.tree.map(
        lambda leaf: jnp.zeros(leaf.shape, leaf.dtype),
        jax.eval_shape(step, state, keys[0])[1],
    )
    return jax.lax.scan(go_on, (state, blank), keys)[0]


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """Keeps Python from collecting garbage inside, as `timeit` does."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@contextlib.contextmanager
def cold_compilation() -> Iterator[None]:
    """Compiles inside as a first run does, whatever earlier ones have kept."""
    was_enabled = jax.config.values["jax_enable_compilation_cache"]
    jax.config.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()  # it remembers whether it is in use
    try:
        yield
    finally:
        jax.config.update("jax_enable_compilation_cache", was_enabled)
        compilation_cache.reset_cache()
