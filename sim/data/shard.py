"""Makes one shard of a store: the unit of work of `prepare`.

What a shard holds follows from its inputs and the settings alone, so whoever makes it,
and however often, makes the same bytes.
"""

import dataclasses
import pathlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from . import entry, inputs, store, tally as tallies
from .base import BadRecord
from .inputs import Input
from .pack import PackConfig
from .packed import Packed
from .tally import Tally


class RecordError(ValueError):
    """Records that end a run; the message names the first, and why."""


@dataclasses.dataclass(frozen=True)
class Job:
    """A shard to be made."""

    path: pathlib.Path
    inputs: Sequence[Input]
    config: PackConfig
    strict: bool  # whether the first bad record ends the work

    @property
    def listing(self) -> pathlib.Path:
        """The file beside the shard that says what it holds."""
        return self.path.with_suffix(".json")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Made:
    """A shard that is there: its SHA-256, and the sums of its list."""

    sha256: str
    tally: Tally


def finished(job: Job) -> Made | None:
    """Returns the shard that an earlier run finished, if it and its list are whole."""
    if not (job.listing.is_file() and job.path.is_file()):
        return None
    try:
        listing = store.read_json(job.listing)
        made = Made(sha256=listing["sha256"], tally=tallies.tally_of(listing))
        [entry.Entry(**fields) for fields in listing["scenarios"]]
    except (ValueError, LookupError, TypeError, AttributeError):
        return None
    return made if made.sha256 == store.file_digest(job.path) else None


def make(job: Job, tick: Callable[[int, int], None]) -> Made:
    """Writes a shard and its list.

    Args:
        job: what to make.
        tick: called after each record with the inputs and scenarios done.

    Raises:
        RecordError: on the first bad record, if the job is strict.
    """
    bad: list[dict[str, Any]] = []
    entries: list[dict[str, Any]] = []

    def scenarios() -> Iterator[Packed]:
        for number, item in enumerate(job.inputs):
            for record in inputs.packed_records(item, job.config):
                if isinstance(record, BadRecord):
                    if job.strict:
                        raise RecordError(str(record))
                    bad.append(_bad_entry(record))
                else:
                    entries.append(dataclasses.asdict(entry.entry_of(record)))
                    yield record
                tick(number, len(entries))

    digest = store.write_shard(job.path, scenarios())
    listing = {"sha256": digest, "bad": bad, "scenarios": entries}
    store.write_json(job.listing, listing)
    return Made(sha256=digest, tally=tallies.tally_of(listing))


def _bad_entry(record: BadRecord) -> dict[str, Any]:
    index = record.record_index
    return {"file": str(record.path), "record": index, "reason": record.reason}
