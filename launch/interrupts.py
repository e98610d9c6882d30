"""Notes Ctrl-C and SIGTERM during work that may stop between its steps alone."""

import contextlib
import os
import signal
from collections.abc import Iterator, Sequence
from types import FrameType

AGAIN = 75  # exit code of who was told to end and can go on: BSD's EX_TEMPFAIL


class Terminated(KeyboardInterrupt):
    """The process was told to end by SIGTERM, as schedulers do."""


class Notice:
    """Whether somebody has asked the work to stop."""

    def __init__(self) -> None:
        """Begins with nobody having asked."""
        self._came: list[int] = []

    def note(self, number: int) -> None:
        """Notes a signal."""
        self._came.append(number)

    @property
    def came(self) -> bool:
        """Whether there was a signal."""
        return bool(self._came)

    def check(self) -> None:
        """Raises KeyboardInterrupt if there was a signal, Terminated if SIGTERM."""
        if self._came:
            is_sigterm = self._came[0] == signal.SIGTERM
            raise Terminated if is_sigterm else KeyboardInterrupt


@contextlib.contextmanager
def noted(
    signals: Sequence[int] = (signal.SIGINT,), hint: str = ""
) -> Iterator[Notice]:
    """Notes Ctrl-C, or other signals too, so that they are raised where the work asks.

    Python raises the first wherever the program happens to be: in a callback of the
    garbage collector, such as that of XLA, it is printed and lost. SIGTERM would end it
    without a word. A second signal does at once what the first would have done.

    Args:
        signals: SIGINT, SIGTERM or both.
        hint: to be written to standard error when a signal comes.

    Yields:
        What knows of a signal; if there was one, the end of the work raises it.
    """
    notice = Notice()

    def note(number: int, frame: FrameType | None) -> None:
        notice.note(number)
        restore()
        if hint:  # print may be at work already
            os.write(2, f"\n{hint}\n".encode())

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    before = {number: signal.signal(number, note) for number in signals}
    try:
        yield notice
        notice.check()
    finally:
        restore()
