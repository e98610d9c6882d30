"""Makes one shard of a store: the unit of work of `prepare`.

What a shard holds follows from its inputs and the settings alone, so whoever makes it,
and however often, makes the same bytes.
"""

import dataclasses
import pathlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from . import entry, inputs, store
from .base import BadRecord
from .inputs import Input
from .pack import PackConfig
from .packed import Packed


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


def finished(job: Job) -> dict[str, Any] | None:
    """Returns the list of a shard that an earlier run finished, if it is whole."""
    if not (job.listing.is_file() and job.path.is_file()):
        return None
    shard = store.read_json(job.listing)
    return shard if shard["sha256"] == store.file_digest(job.path) else None


def make(job: Job, tick: Callable[[int, int], None]) -> dict[str, Any]:
    """Writes a shard and its list.

    Args:
        job: what to make.
        tick: called after each record with the inputs and scenarios done.

    Returns:
        The list: the shard's SHA-256, its scenarios, and the bad records of its inputs.

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
    shard = {"sha256": digest, "bad": bad, "scenarios": entries}
    store.write_json(job.listing, shard)
    return shard


def _bad_entry(record: BadRecord) -> dict[str, Any]:
    index = record.record_index
    return {"file": str(record.path), "record": index, "reason": record.reason}
