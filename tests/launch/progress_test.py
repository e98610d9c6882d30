"""Tests that progress is shown when it helps, and not otherwise."""

import io

import pytest
from rich.console import Console

from drivetrain.launch import progress


class Clock:
    """A clock that the test sets."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        """Returns the seconds that the test has set."""
        return self.now


def lines_of(seconds: float, *, terminal: bool = False, start: int = 0) -> list[str]:
    """Runs a job of ten units a second, and returns what it showed."""
    clock, out = Clock(), io.StringIO()
    console = Console(file=out, force_terminal=terminal, width=100)
    total = start + round(10 * seconds)
    with progress.progress(
        "training", total, unit="steps", start=start, console=console, clock=clock
    ) as line:
        for done in range(start, total + 1):
            clock.now = 100.0 + (done - start) / 10
            line.update(done, "return 3.1")
    return out.getvalue().splitlines()


def test_a_short_job_is_silent() -> None:
    assert lines_of(1.9) == []
    assert lines_of(1.9, terminal=True) == []


def test_a_long_job_says_its_rate_and_the_time_left() -> None:
    assert lines_of(10) == [
        "training: 20 of 100 steps, 10/s, 8 s left, return 3.1",
        "training: 70 of 100 steps, 10/s, 3 s left, return 3.1",
        "training: 100 steps in 10 s, 10/s",
    ]


def test_what_was_done_before_a_resumption_does_not_count_into_the_rate() -> None:
    assert lines_of(3, start=1000)[0] == (
        "training: 1,020 of 1,030 steps, 10/s, 1 s left, return 3.1"
    )


def test_a_terminal_gets_a_bar() -> None:
    assert "\u2501" in "".join(lines_of(10, terminal=True))


def test_the_rate_forgets_a_slow_start() -> None:
    clock, out = Clock(), io.StringIO()
    with progress.progress(
        "training", 1000, unit="steps", console=Console(file=out), clock=clock
    ) as line:
        for done in range(101):  # the first step takes a minute, the others a second
            clock.now = 160.0 + done
            line.update(done)
    assert "training: 60 of 1,000 steps, 1.0/s, 15 min 40 s left" in out.getvalue()


def test_the_first_step_foretells_no_time() -> None:
    clock, out = Clock(), io.StringIO()
    with progress.progress(
        "training", 100, unit="steps", console=Console(file=out), clock=clock
    ) as line:
        clock.now += 60  # compiles
        line.update(1)
        for done in range(2, 8):
            clock.now += 1
            line.update(done)
    assert out.getvalue().splitlines()[:2] == [
        "training: 1 of 100 steps",
        "training: 6 of 100 steps, 1.0/s, 1 min 34 s left",
    ]


def test_a_job_of_unknown_size_says_its_rate() -> None:
    clock, out = Clock(), io.StringIO()
    with progress.progress(
        "preparing", None, unit="files", console=Console(file=out), clock=clock
    ) as line:
        clock.now += 4
        line.update(400)
    assert out.getvalue().splitlines()[0] == "preparing: 400 files, 100/s"


def test_a_job_that_fails_claims_no_success() -> None:
    clock, out = Clock(), io.StringIO()
    console = Console(file=out, force_terminal=True)
    with (
        pytest.raises(KeyboardInterrupt),
        progress.progress(
            "training", 9, unit="steps", console=console, clock=clock
        ) as line,
    ):
        clock.now += 4
        line.update(1)
        raise KeyboardInterrupt
    assert " in 4 s" not in out.getvalue()


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.4, "0 s"), (59.6, "1 min 0 s"), (125.0, "2 min 5 s"), (7300.0, "2 h 1 min")],
)
def test_a_duration_reads_in_two_units(seconds: float, text: str) -> None:
    assert progress.duration(seconds) == text
