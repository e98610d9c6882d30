"""Tests that Ctrl-C ends the work wherever it comes."""

import gc
import pathlib
import signal
from collections.abc import Iterator

import pytest

from drivetrain.launch import interrupts, stores


@pytest.fixture
def presses() -> Iterator[list[str]]:
    """Presses Ctrl-C when the garbage collector begins, as often as this is filled."""
    left: list[str] = []

    def press(phase: str, info: dict[str, int]) -> None:
        if phase == "start" and left:
            left.pop()
            signal.raise_signal(signal.SIGINT)

    gc.callbacks.append(press)
    yield left
    gc.callbacks.remove(press)


@pytest.fixture(autouse=True)
def heeded() -> Iterator[None]:
    """Heeds Ctrl-C, which a shell tells what runs in the background to ignore."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_what_comes_in_a_callback_is_raised_at_the_next_look(presses) -> None:
    seen = []
    with pytest.raises(KeyboardInterrupt):
        with interrupts.noted() as notice:
            notice.check()
            presses.append("once")
            gc.collect()
            seen.append("goes on")
            notice.check()
            seen.append("too far")
    assert seen == ["goes on"]


def test_what_comes_after_the_last_look_is_raised_at_the_end() -> None:
    with pytest.raises(KeyboardInterrupt):
        with interrupts.noted():
            signal.raise_signal(signal.SIGINT)


def test_sigterm_is_told_from_ctrl_c(capfd: pytest.CaptureFixture) -> None:
    both = (signal.SIGINT, signal.SIGTERM)
    with pytest.raises(interrupts.Terminated):
        with interrupts.noted(both, "wait") as notice:
            signal.raise_signal(signal.SIGTERM)
            assert notice.came
    assert "wait" in capfd.readouterr().err
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_a_second_one_is_raised_at_once_and_all_is_as_before() -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        with interrupts.noted():
            signal.raise_signal(signal.SIGINT)
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_prepare_that_is_interrupted_in_a_callback_ends(
    drivetrain, presses, monkeypatch, tmp_path: pathlib.Path, workers: str
) -> None:
    prepare = stores.preparing.prepare

    def pressed(*args):
        presses.append("once")
        gc.collect()
        return prepare(*args)

    monkeypatch.setattr(stores.preparing, "prepare", pressed)
    words = ["prepare", "synthetic:0:32", "store", "--workers", workers]
    assert drivetrain(*words) == 130
    assert not (tmp_path / "store" / "manifest.json").exists()
