"""Turns files of logs into a store, shard by shard, and continues where it was cut."""

import dataclasses
import functools
import importlib.metadata
import json
import pathlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from . import loader, store
from .base import BadRecord
from .pack import QUANTUM, PackConfig, Packed

SHARD_BYTES = 2**26  # of input files per shard; a larger file makes a shard of its own
PLAN = "plan.json"


class RecordError(ValueError):
    """Records that end a run; the message names the first, and why."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Summary:
    """What a run of `prepare` found."""

    num_scenarios: int
    num_shards: int
    num_continued: int  # shards that an earlier run had finished
    num_bytes: int  # of all scenarios in the bank
    num_coarse: int  # wider than 655 m, so that places are kept to more than 1 cm
    num_index_dropped: int  # candidates that did not fit into the index of road edges
    bad: list[dict[str, Any]]  # file, record and reason of each record left out
    duplicates: list[str]  # scenario ids that came more than once

    def reasons(self) -> list[tuple[str, int]]:
        """Returns the reasons for which records were left out, most frequent first."""
        kinds = Counter(record["reason"].split(":")[0] for record in self.bad)
        return kinds.most_common()


def prepare(
    files: Sequence[pathlib.Path],
    out: pathlib.Path,
    config: PackConfig,
    strict: bool = False,
    tick: Callable[[int, int], None] = lambda num_files, num_scenarios: None,
) -> Summary:
    """Makes a store of files, or finishes one that an earlier run began.

    Args:
        files: of any known format.
        out: the folder of the store; made if it is not there.
        config: how scenarios are packed.
        strict: whether the first bad record ends the run.
        tick: called after each record with the files and scenarios done.

    Raises:
        RecordError: on the first bad record of a strict run, or if no record is usable;
            then nothing is left behind
            but what an earlier run had finished.
        FileExistsError: if the folder holds something else, or a store of other files
            or settings.
    """
    is_new = _claim(out, _plan(files, config))
    try:
        shards = _shards(files, out, config, strict, tick)
        bad = [record for shard in shards for record in shard["bad"]]
        if strict and bad:
            record = bad[0]
            raise RecordError(
                f"{record['file']}, record {record['record']}: {record['reason']}"
            )
        entries = [entry for shard in shards for entry in shard["scenarios"]]
        if not entries:
            first = bad[0] if bad else {"file": files[0], "reason": "it has no record"}
            raise RecordError(
                f"no usable scenario in {len(files)} files; the first record left out "
                f"is of {first['file']}: {first['reason']}"
            )
    except RecordError:
        if is_new:
            _clear(out)
        raise
    counts = Counter(entry["scenario_id"] for entry in entries)
    store.write_json(
        out / store.MANIFEST,
        {
            "format_version": store.FORMAT_VERSION,
            "drivetrain": importlib.metadata.version("drivetrain"),
            "pack": dataclasses.asdict(config),
            "num_scenarios": len(entries),
            "num_bad_records": len(bad),
            "shards": [{"name": s["name"], "sha256": s["sha256"]} for s in shards],
        },
    )
    return Summary(
        num_scenarios=len(entries),
        num_shards=len(shards),
        num_continued=sum(shard["continued"] for shard in shards),
        num_bytes=sum(entry["num_bytes"] for entry in entries),
        num_coarse=sum(entry["quantum"] > QUANTUM for entry in entries),
        num_index_dropped=sum(entry["num_index_dropped"] for entry in entries),
        bad=bad,
        duplicates=[name for name, count in counts.items() if count > 1],
    )


def _plan(files: Sequence[pathlib.Path], config: PackConfig) -> dict[str, Any]:
    """Returns what a store is made of: a store of another plan is another store."""
    inputs = [[str(path.resolve()), path.stat().st_size] for path in files]
    return {"pack": dataclasses.asdict(config), "files": inputs}


def _claim(out: pathlib.Path, plan: dict[str, Any]) -> bool:
    """Makes the folder of the store, or checks that an earlier run made it.

    Returns:
        Whether the store is new.
    """
    if (out / PLAN).is_file():
        if json.loads((out / PLAN).read_text()) != plan:
            raise FileExistsError(
                f"'{out}' holds a store of other files or settings; name another "
                "folder, or delete this one first"
            )
        return False
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FileExistsError(f"'{out}' is there and no store; name a new folder")
    out.mkdir(parents=True, exist_ok=True)
    store.write_json(out / PLAN, plan)
    return True


def _groups(files: Sequence[pathlib.Path]) -> Iterator[list[pathlib.Path]]:
    """Yields the files of each shard: the same files make the same shards."""
    group: list[pathlib.Path] = []
    size = 0
    for path in files:
        group.append(path)
        size += path.stat().st_size
        if size >= SHARD_BYTES:
            yield group
            group, size = [], 0
    if group:
        yield group


def _shards(files, out, config, strict, tick) -> list[dict[str, Any]]:
    """Writes the shards that are not there yet, and returns the lists of all."""
    shards: list[dict[str, Any]] = []
    num_files = num_scenarios = 0
    for number, group in enumerate(_groups(files)):
        path = out / f"shard-{number:05d}.array_record"
        listing = path.with_suffix(".json")
        shard = _finished(path, listing)
        continued = shard is not None
        if shard is None:
            progress = functools.partial(_add, tick, num_files, num_scenarios)
            shard = _write_shard(path, group, config, strict, progress)
            store.write_json(listing, shard)
        shards.append({**shard, "name": path.name, "continued": continued})
        num_files += len(group)
        num_scenarios += len(shard["scenarios"])
        tick(num_files, num_scenarios)
    return shards


def _finished(path, listing) -> dict[str, Any] | None:
    """Returns the list of a shard that an earlier run finished, if it is whole."""
    if not (listing.is_file() and path.is_file()):
        return None
    shard = json.loads(listing.read_text())
    return shard if shard["sha256"] == store.file_digest(path) else None


def _add(tick, files_before, scenarios_before, num_files, num_scenarios) -> None:
    tick(files_before + num_files, scenarios_before + num_scenarios)


def _write_shard(path, group, config, strict, tick) -> dict[str, Any]:
    bad: list[dict[str, Any]] = []
    entries: list[dict[str, Any]] = []

    def scenarios() -> Iterator[Packed]:
        for number, file in enumerate(group):
            for record in loader.packed_records(file, config):
                if isinstance(record, BadRecord):
                    if strict:
                        raise RecordError(str(record))
                    bad.append(_bad_entry(record))
                else:
                    entries.append(_entry(record))
                    yield record
                tick(number, len(entries))

    digest = store.write_shard(path, scenarios())
    return {"sha256": digest, "bad": bad, "scenarios": entries}


def _clear(out: pathlib.Path) -> None:
    """Takes back what `prepare` wrote."""
    for path in [out / PLAN, *out.glob("shard-*")]:
        path.unlink(missing_ok=True)
    out.rmdir()


def _bad_entry(record: BadRecord) -> dict[str, Any]:
    index = record.record_index
    return {"file": str(record.path), "record": index, "reason": record.reason}


def _entry(packed: Packed) -> dict[str, Any]:
    return {
        "scenario_id": packed.scenario_id,
        "dataset": packed.dataset,
        "ego_source": packed.ego_source,
        "route_source": packed.route_source,
        "num_steps": packed.num_steps,
        "num_objects": len(packed.object_id),
        "num_vertices": len(packed.vertices),
        "num_lights": len(packed.light_xyz),
        "num_index_dropped": packed.num_index_dropped,
        "num_bytes": packed.num_bytes,
        "quantum": packed.quantum if packed.poses.dtype == np.int16 else 0.0,
    }
