"""Draws a store through a bank that is smaller: pages of it, in an order that resumes.

The next pages are read and laid out by a thread of their own while the program runs.
"""

import concurrent.futures
import copy
import dataclasses
import pathlib
from collections.abc import Mapping
from typing import Any

import grain
import jax
import numpy as np

from .. import ranges
from . import pages, store
from .bank import Bank
from .loader import Source, SourceError, wanted_numbers
from .pages import Layout


@dataclasses.dataclass(frozen=True, kw_only=True)
class StreamConfig:
    """Whether and how a store streams through the bank."""

    resident: int | None = None  # scenarios in a process's bank; None: all, for good
    pages: int = 8  # of the bank; one is replaced at a time
    updates_per_page: int = 500  # of the learner, after which one is replaced

    def __post_init__(self) -> None:
        """Checks the counts.

        Raises:
            ValueError: if a count is below 1, or pages would be empty.
        """
        ranges.require_at_least(self, pages=1, updates_per_page=1)
        if self.resident is not None and self.resident < self.pages:
            raise ValueError(
                f"resident must be at least the {self.pages} pages, got "
                f"{self.resident}."
            )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Part:
    """Which records of the store this process draws, among how many processes."""

    process: int = 0
    num_processes: int = 1


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Page:
    """One page for each device of this process, and the state of the stream with it."""

    number: int  # the place in the bank
    bank: Bank  # host arrays with a leading axis of devices
    state: dict[str, Any]


ALL = Part()


class Stream:
    """Pages of a store, one after the other, without end."""

    def __init__(
        self,
        source: Source,
        config: StreamConfig,
        max_objects: int,
        num_devices: int,
        seed: int = 0,
        part: Part = ALL,
    ):
        """Opens a store.

        Args:
            source: a store, and which of its scenarios are wanted.
            config: `resident` counts the scenarios of all devices of this process.
            max_objects: of a scenario, those that matter most to the ego.
            num_devices: of this process, that share what is resident.
            seed: of the order.
            part: what this process draws.

        Raises:
            ValueError: if the source is no store, or `resident` is not a multiple of
                pages and devices.
            SourceError: if the store holds fewer scenarios than are to be resident.
        """
        per_page = _scenarios_per_page(source, config, num_devices)
        wanted = wanted_numbers(source)
        numbers = _own(wanted, source, config, part)
        path = pathlib.Path(source.path)
        entries = store.entries(path)
        self.layout = Layout.of(  # the same in all processes
            [entries[number] for number in wanted],
            max_objects,
            config.pages,
            per_page,
        )
        self.num_scenarios = len(numbers)
        self._sizes = self.layout.sizes_of(entries)
        self._records = store.Records(path)
        self._num_devices = num_devices
        dataset = grain.MapDataset.source(numbers).seed(seed).shuffle().repeat()
        self._order = iter(dataset.to_iter_dataset(grain.ReadOptions(num_threads=0)))
        self._waiting: list[int] = []
        self._held: list[list[list[int]]] = []  # numbers by page and device
        self._next = 0  # the page that is replaced next
        self._thread = concurrent.futures.ThreadPoolExecutor(1, "drivetrain-stream")
        self._coming: concurrent.futures.Future[Page] | None = None
        self.state: dict[str, Any] = {}

    def fill(self, state: Mapping[str, Any] | None = None) -> Bank:
        """Returns the whole bank, and begins to make the next page.

        Args:
            state: of an earlier stream of the same store, as it was beside its bank;
                None to begin.

        Returns:
            Host arrays with a leading axis of devices.
        """
        if self._coming is not None:
            self._coming.result()  # of an order that ends here
        if state is None:
            self._held = [self._choose() for _ in range(self.layout.num_pages)]
        else:
            self._order.set_state(copy.deepcopy(state["order"]))
            self._waiting = list(state["waiting"])
            self._held = [list(map(list, page)) for page in state["held"]]
            self._next = int(state["next"])
        self.state = self._state()
        made = [
            self._pages(number, numbers) for number, numbers in enumerate(self._held)
        ]
        self._ahead()
        by_device = zip(*made, strict=True)
        return _stacked([pages.joined(own) for own in by_device])

    def take(self) -> Page:
        """Returns the next page, waits for it if need be, and begins the one after."""
        if self._coming is None:
            raise RuntimeError("fill the bank before taking pages")
        page = self._coming.result()
        self.state = page.state
        self._ahead()
        return page

    def close(self) -> None:
        """Ends the thread; what it is making is dropped."""
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _ahead(self) -> None:
        self._coming = self._thread.submit(self._make)

    def _make(self) -> Page:
        number = self._next
        self._held[number] = self._choose()
        self._next = (number + 1) % self.layout.num_pages
        made = self._pages(number, self._held[number])
        return Page(number=number, bank=_stacked(made), state=self._state())

    def _choose(self) -> list[list[int]]:
        """Returns the numbers of a page on each device."""
        found = []
        for _ in range(self._num_devices):
            chosen, self._waiting = pages.choose(
                self._sizes,
                self.layout.scenarios_per_page,
                self._waiting,
                self._order,
            )
            found.append(chosen)
        return found

    def _pages(self, number: int, numbers: list[list[int]]) -> list[Bank]:
        return [
            pages.page(self.layout, [self._records[i] for i in own], number)
            for own in numbers
        ]

    def _state(self) -> dict[str, Any]:
        state = {
            "order": self._order.get_state(),
            "waiting": self._waiting,
            "held": self._held,
            "next": self._next,
        }
        return copy.deepcopy(state)


def _scenarios_per_page(source: Source, config: StreamConfig, num_devices: int) -> int:
    """Returns how many there are of one device, if the source can stream so."""
    if not source.is_store:
        raise ValueError(
            f"'{source.path}' cannot stream: it is no store; make one with "
            f"'drivetrain prepare {source.path} STORE', or leave stream.resident out"
        )
    num_places = config.pages * num_devices
    resident = config.resident or 0
    if not resident or resident % num_places:
        raise ValueError(
            f"stream.resident must be a multiple of {config.pages} pages on "
            f"{num_devices} devices, got {config.resident}."
        )
    return resident // num_places


def _own(
    wanted: list[int], source: Source, config: StreamConfig, part: Part
) -> list[int]:
    """Returns the numbers of the records that a process draws."""
    numbers = wanted[part.process :: part.num_processes]
    if len(numbers) < (config.resident or 0):
        raise SourceError(
            f"'{source.path}' has {len(numbers)} scenarios of those wanted, fewer than "
            f"the {config.resident} of stream.resident; leave it out to hold them all"
        )
    return numbers


def _stacked(banks: list[Bank]) -> Bank:
    return jax.tree.map(lambda *arrays: np.stack(arrays), *banks)
