"""Shows the progress of a job: how far it is, how fast it goes and how long it takes.

The lines go to standard error: a bar on a terminal, elsewhere a line every few seconds.
Standard output is left to results.
"""

import collections
import contextlib
import time
from collections.abc import Callable, Iterator

from rich import console as rich_console, progress as rich_progress

from . import cluster

SILENT_SECONDS = 2.0  # a job that ends sooner says nothing
PLAIN_SECONDS = 5.0  # between two lines where there is no terminal
RATE_SECONDS = 30.0  # the rate is that of the latest stretch


@contextlib.contextmanager
def progress(
    label: str,
    total: int | None,
    *,
    unit: str,
    start: int = 0,
    console: rich_console.Console | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator["ProgressLine"]:
    """Shows progress while the job inside runs, and its duration when it has succeeded.

    Args:
        label: what the job does, such as `training`.
        total: how much there is to do; None where nobody knows.
        unit: what is counted, in the plural.
        start: how much was done before, by the run that is resumed.
        console: where to show it; standard error by default.
        clock: seconds that never run backwards.
    """
    shown = console or rich_console.Console(stderr=True, quiet=not cluster.speaks())
    line = ProgressLine(label, total, unit, start, shown, clock)
    try:
        yield line
    except BaseException:
        line.stop()
        raise
    line.finish()


class ProgressLine:
    """How far one job is; `progress` makes it."""

    def __init__(
        self,
        label: str,
        total: int | None,
        unit: str,
        start: int,
        console: rich_console.Console,
        clock: Callable[[], float],
    ) -> None:
        """Starts the clock."""
        self._label, self._total, self._unit = label, total, unit
        self._start, self._done = start, start
        self._console, self._clock = console, clock
        self._began = clock()
        self._last_line: float | None = None
        self._recent: collections.deque[tuple[float, int]] = collections.deque()
        self._bar: rich_progress.Progress | None = None

    def update(self, done: int, note: str = "") -> None:
        """Says how much is done by now in all, and in a word how it goes."""
        now, self._done = self._clock(), done
        self._recent.append((now, done))
        while len(self._recent) > 2 and now - self._recent[1][0] > RATE_SECONDS:
            self._recent.popleft()
        if now - self._began < SILENT_SECONDS:
            return
        if self._console.is_terminal:
            self._draw(note)
        elif self._last_line is None or now - self._last_line >= PLAIN_SECONDS:
            self._last_line = now
            self._say(self._status(note))

    def stop(self) -> None:
        """Takes the bar away."""
        if self._bar is not None:
            self._bar.stop()

    def finish(self) -> None:
        """Says how long it took, if the job was long enough to be shown at all."""
        self.stop()
        seconds = self._clock() - self._began
        if self._bar is not None or self._last_line is not None:
            rate = _rate((self._done - self._start) / seconds)
            self._say(f"{self._done:,} {self._unit} in {duration(seconds)}, {rate}")

    def _status(self, note: str) -> str:
        # The first stretch may have been compiling: it foretells nothing.
        is_known = len(self._recent) > 1
        then, before = self._recent[0] if is_known else (self._began, self._start)
        now, done = self._recent[-1]
        rate = (done - before) / (now - then) if now > then else 0.0
        of_total = "" if self._total is None else f" of {self._total:,}"
        parts = [f"{done:,}{of_total} {self._unit}"]
        if is_known or self._total is None:
            parts.append(_rate(rate))
        if is_known and self._total is not None and rate > 0:
            parts.append(f"{duration((self._total - done) / rate)} left")
        return ", ".join([*parts, note] if note else parts)

    def _say(self, text: str) -> None:
        self._console.print(
            f"{self._label}: {text}", highlight=False, markup=False, soft_wrap=True
        )

    def _draw(self, note: str) -> None:
        bar = self._bar
        if bar is None:
            bar = self._bar = rich_progress.Progress(
                rich_progress.TextColumn("{task.description}", markup=False),
                rich_progress.BarColumn(bar_width=24),
                rich_progress.TextColumn("{task.fields[status]}", markup=False),
                console=self._console,
                transient=True,
            )
            bar.add_task(self._label, total=self._total, status="")
            bar.start()
        status = self._status(note)
        bar.update(bar.task_ids[0], completed=self._done, status=status)


def _rate(rate: float) -> str:
    if rate < 1:
        return f"{60 * rate:.1f}/min"
    return f"{rate:,.{0 if rate >= 10 else 1}f}/s"


def duration(seconds: float) -> str:
    """Returns a stretch of time in the two units that matter.

    >>> duration(3725)
    '1 h 2 min'
    """
    minutes, rest = divmod(round(max(seconds, 0.0)), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
