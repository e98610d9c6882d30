"""Keeps two jobs from training in one folder at the same time."""

import contextlib
import fcntl
import logging
import pathlib
import time
from collections.abc import Iterator

logger = logging.getLogger(__name__)

LOCK = "lock"  # a file of the folder; it stays, so that no two are ever locked
PATIENCE_SECONDS = 10.0  # in which what is left of a job that was killed ends
POLL_SECONDS = 0.2


@contextlib.contextmanager
def held(folder: pathlib.Path) -> Iterator[None]:
    """Holds the lock of a folder, which is made where there is none.

    The system gives the lock back when the process ends, however it ends.

    Raises:
        BlockingIOError: if another process still has it after a while.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK).open("a+b") as file:
        _take(file.fileno(), folder)
        yield


def _take(file: int, folder: pathlib.Path) -> None:
    deadline = time.monotonic() + PATIENCE_SECONDS
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if time.monotonic() > deadline:
                raise BlockingIOError(
                    f"another job trains in '{folder}'; wait for its end, or name "
                    "another folder with --out"
                ) from None
            time.sleep(POLL_SECONDS)
        except OSError as error:  # such as of a network that knows no locks
            logger.warning(
                "'%s' cannot be locked (%s); see that no two jobs train in it.",
                folder,
                error.strerror,
            )
            return
