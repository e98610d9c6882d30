"""Shares work among processes that end with the one that began them."""

import concurrent.futures
import contextlib
import multiprocessing
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

CONTEXT = multiprocessing.get_context("spawn")  # JAX has threads, which forks lose


class WorkerError(ChildProcessError):
    """A worker that was killed."""


@contextlib.contextmanager
def pool(
    count: int, begin: Callable[..., None] | None = None, *values: Any
) -> Iterator[concurrent.futures.Executor]:
    """Runs worker processes while the work inside lasts.

    Work that is left when it ends, by an error or by Ctrl-C, is dropped.

    Args:
        count: of workers.
        begin: called in each worker when it begins.
        values: its arguments.

    Raises:
        WorkerError: if a worker was killed.
    """
    made = ProcessPoolExecutor(
        count, CONTEXT, initializer=_begin, initargs=(begin, values)
    )
    try:
        yield made
    except BrokenProcessPool as error:
        raise WorkerError(
            "a worker process was killed, perhaps for want of memory; run the command "
            "again, with fewer workers where it has that option"
        ) from error
    except BaseException:
        for process in list((made._processes or {}).values()):
            process.terminate()
        raise
    finally:
        made.shutdown(wait=True, cancel_futures=True)


def _begin(begin: Callable[..., None] | None, values: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends the work
    if begin is not None:
        begin(*values)
