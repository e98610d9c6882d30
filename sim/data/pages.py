"""Divides a bank into pages of equal room, of which one after the other is replaced.

A page is a bank of a few scenarios. Pages laid end to end are a bank again, once each
knows where its rows begin.
"""

import collections
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .bank import FIRST, MAX_ROWS, TABLES, Bank, Sizes, build
from .entry import Entry
from .packed import Packed

DEVIATIONS = 2.0  # standard deviations of a page's rows that its room allows for
MAX_DRAWS = 50  # for each place of a page


@dataclasses.dataclass(frozen=True, kw_only=True)
class Layout:
    """How one device's bank is divided."""

    sizes: Sizes
    num_pages: int
    scenarios_per_page: int
    room: Mapping[str, int]  # rows of a page's tables, without padding

    @classmethod
    def of(
        cls,
        entries: Sequence[Entry],
        max_objects: int,
        num_pages: int,
        scenarios_per_page: int,
    ) -> "Layout":
        """Returns a layout whose pages hold scenarios drawn from these.

        Raises:
            ValueError: if there are too many rows for one device.
        """
        room = {}
        for kind in TABLES:
            rows = np.array([entry.rows[kind] for entry in entries], np.float64)
            count = scenarios_per_page
            spread = DEVIATIONS * np.sqrt(count) * rows.std()
            others = rows.max() + (count - 1) * rows.mean()
            room[kind] = int(np.ceil(max(count * rows.mean() + spread, others)))
        layout = cls(
            sizes=Sizes.of(entries, max_objects),
            num_pages=num_pages,
            scenarios_per_page=scenarios_per_page,
            room=room,
        )
        most = num_pages * max(layout.capacity.values())
        if most > MAX_ROWS:
            raise ValueError(
                f"{most:,} rows do not fit into one device's bank: use more devices or "
                "fewer resident scenarios."
            )
        return layout

    def sizes_of(
        self, entries: Sequence[Entry]
    ) -> Float[np.ndarray, "scenarios kinds"]:
        """Returns the share of a page's room that each scenario takes."""
        rows = [[entry.rows[kind] for kind in self.room] for entry in entries]
        return np.array(rows, np.float64) / np.maximum(list(self.room.values()), 1)

    @property
    def capacity(self) -> dict[str, int]:
        """Rows of a page's tables, padding included."""
        padding = self.sizes.padding
        return {kind: rows + padding[kind] for kind, rows in self.room.items()}


def choose(
    sizes: Float[np.ndarray, "scenarios kinds"],
    count: int,
    waiting: Sequence[int],
    order: Iterator[int],
) -> tuple[list[int], list[int]]:
    """Chooses the scenarios of a page: those that wait, then in order, if they fit.

    A scenario that does not fit beside the others waits for the next page. When as many
    wait as a page holds, the largest chosen one makes room for smaller ones.

    Args:
        sizes: the share of a page's room that each scenario takes, by its number.
        count: of scenarios in a page.
        waiting: numbers of those that did not fit into pages before.
        order: numbers without end.

    Returns:
        The numbers of the page, and of those that wait now.

    Raises:
        ValueError: if hardly any scenarios fit beside one another.
    """
    chosen: list[int] = []
    left: list[int] = []
    candidates = collections.deque(waiting)

    def fits(number: int) -> bool:
        return bool((sizes[[*chosen, number]].sum(axis=0) <= 1.0).all())

    for _ in range(MAX_DRAWS * count):
        if len(chosen) == count:
            return chosen, [*left, *candidates]
        number = candidates.popleft() if candidates else next(order)
        if len(left) >= count and chosen and not fits(number):
            largest = max(chosen, key=lambda other: sizes[other].max())
            if sizes[number].max() < sizes[largest].max():
                chosen.remove(largest)
                left.append(largest)
        if fits(number):
            chosen.append(number)
        else:
            left.append(number)
    raise ValueError(
        f"no {count} scenarios fit into a page together; use more scenarios per page"
    )


def page(layout: Layout, scenarios: Sequence[Packed], number: int) -> Bank:
    """Returns scenarios as one page of a bank.

    Args:
        layout: of the bank.
        scenarios: as many as a page holds, which fit into it.
        number: of the page in the bank.
    """
    made = build(scenarios, layout.sizes, layout.capacity)
    places = {
        FIRST[kind]: getattr(made, FIRST[kind]) + number * rows
        for kind, rows in layout.capacity.items()
    }
    return made.replace(
        **{name: place.astype(np.int32) for name, place in places.items()}
    )


def joined(pages: Sequence[Bank]) -> Bank:
    """Lays the pages of a bank end to end."""
    first = pages[0]
    fields = {
        field.name: [getattr(one, field.name) for one in pages]
        for field in dataclasses.fields(first)
        if field.name != "sizes"
    }
    arrays: dict[str, Any] = {
        name: np.concatenate(parts) if parts[0].ndim else parts[0]
        for name, parts in fields.items()
    }
    count = sum(int(one.num_scenarios) for one in pages)
    arrays["num_scenarios"] = np.array(count, np.int32)
    return Bank(sizes=first.sizes, **arrays)
