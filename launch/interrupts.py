"""Notes Ctrl-C during work that may stop between its steps alone."""

import contextlib
import signal
from collections.abc import Callable, Iterator
from types import FrameType


@contextlib.contextmanager
def noted() -> Iterator[Callable[[], None]]:
    """Notes Ctrl-C, so that it is raised where the work asks.

    Python raises it wherever the program happens to be: in a callback of the garbage
    collector, such as that of XLA, it is printed and lost. A second one is raised at
    once.

    Yields:
        What raises KeyboardInterrupt if there was one; the end of the work does too.
    """
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)
        signal.signal(signal.SIGINT, before)

    def check() -> None:
        if came:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, note)
    try:
        yield check
        check()
    finally:
        signal.signal(signal.SIGINT, before)
