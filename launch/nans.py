"""Finds the operation at which a run's numbers cease to be numbers."""

import pathlib
import traceback
from collections.abc import Callable

import jax
import jax.numpy as jnp

from ..learners.base import Bank, Metrics, Program, TrainState
from . import divergence

ROOT = pathlib.Path(__file__).resolve().parents[1]


class NoNumberError(ValueError):
    """An operation whose result is no number."""


def searched(program: Program, single: Program, say: Callable[[str], None]) -> Program:
    """Returns a program that looks for the operation where its updates go wrong.

    It keeps the state before each call. From there it comes to the update that went
    wrong, and goes through that one operation by operation, which takes minutes.

    Args:
        program: several updates.
        single: the same, of one update.
        say: is told what takes so long.

    Raises:
        NoNumberError: by the program, if it finds the operation; names its line.
    """

    def run(train_state: TrainState, bank: Bank) -> tuple[TrainState, Metrics]:
        before = jax.tree.map(jnp.copy, train_state)
        after, metrics = program(train_state, bank)
        wrong = divergence.first_wrong(jax.device_get(metrics))
        if wrong is not None:
            for _ in range(wrong):
                before, _ = single(before, bank)
            say("going through one update operation by operation: this takes minutes")
            _search(single, before, bank)
        return after, metrics

    return run


def _search(single: Program, train_state: TrainState, bank: Bank) -> None:
    try:
        with jax.disable_jit(), jax.debug_nans(True):
            single(train_state, bank)
    except FloatingPointError as error:
        frames = traceback.extract_tb(error.__traceback__)
        ours = [frame for frame in frames if _is_ours(frame)]
        path = pathlib.Path(ours[-1].filename).relative_to(ROOT)
        raise NoNumberError(
            f"the first result that is no number is that of {path}:{ours[-1].lineno}, "
            f"in {ours[-1].name}: {ours[-1].line}"
        ) from error


def _is_ours(frame: traceback.FrameSummary) -> bool:
    path = pathlib.Path(frame.filename)
    return path.is_relative_to(ROOT) and path.relative_to(ROOT).parts[0] != ".venv"
