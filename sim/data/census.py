"""Counts which scenarios of a source are wanted, to say why none is."""

from collections import Counter
from collections.abc import Callable

from .entry import Entry
from .query import Query


class Census:
    """Scenarios so far, by the conditions of a query that they meet."""

    def __init__(self, split: str, query: Query):
        """Begins to count.

        Args:
            split: which part is wanted; "all" for no part.
            query: which scenarios of it are.
        """
        self._split, self._query = split, query
        self._conditions = query.conditions()
        self._num = self._num_in_split = 0
        self._met: Counter[str] = Counter()
        self._datasets: set[str] = set()

    def admits(self, is_in_split: bool, entry: Callable[[], Entry]) -> bool:
        """Counts a scenario and tells whether it is wanted.

        Args:
            is_in_split: whether it belongs to the split.
            entry: looks at the scenario; called where the query asks for something.
        """
        self._num += 1
        self._num_in_split += is_in_split
        if not is_in_split or self._query.is_open:
            return is_in_split
        found = entry()
        self._datasets.add(found.dataset)
        for text, condition in self._conditions.items():
            self._met[text] += condition.matches(found)
        return self._query.matches(found)

    def sentence(self) -> str:
        """Returns what became of the scenarios; empty where there is none."""
        if not self._num:
            return ""
        if not self._num_in_split:
            other = "test" if self._split == "train" else "train"
            return f"all {self._num:,} are in split {other}; change split or test_share"
        noun = "scenario" if self._num_in_split == 1 else "scenarios"
        place = "" if self._split == "all" else f" in split {self._split}"
        counts = ", ".join(
            f"{self._met[text]:,} of them with {text}" for text in self._conditions
        )
        said = f"{self._num_in_split:,} {noun}{place}, {counts}"
        if len(self._conditions) > 1:
            said += ", none with all of it"
        if self._query.dataset not in (None, *self._datasets):
            said += f"; datasets in it: {', '.join(sorted(self._datasets))}"
        return said
