"""Turns files of logs into a store, shard by shard, and continues where it was cut."""

import concurrent.futures
import dataclasses
import itertools
import math
import pathlib
import queue
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from . import plan as plans, shard as shards, store, tally as tallies, workers
from .inputs import Input
from .pack import PackConfig
from .shard import Job, Made, RecordError
from .tally import Tally

# The most that a shard is made of; a larger file makes a shard of its own.
SHARD_BYTES = 2**26  # of input files
SHARD_SEEDS = 256  # of the generator
FEW_SHARDS = 32  # of smaller sets: enough for the workers of most machines
LEAST = 1 / 32  # of the most: 2 MB, 8 seeds
PATIENCE = 0.2  # seconds between looks at the workers

Tick = Callable[[int, int], None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Summary:
    """What a run of `prepare` found."""

    num_scenarios: int
    num_shards: int
    num_continued: int  # shards that an earlier run had finished
    num_bytes: int  # of all scenarios in the bank
    num_coarse: int  # wider than 655 m, so that places are kept to more than 1 cm
    share_index_dropped: float  # of candidates, those that no list of edges could hold
    bad: list[dict[str, Any]]  # file, record and reason of each record left out
    duplicates: list[str]  # scenario ids that came more than once

    def reasons(self) -> list[tuple[str, int]]:
        """Returns the reasons for which records were left out, most frequent first."""
        return reasons(self.bad)


def reasons(bad: Sequence[Mapping[str, Any]]) -> list[tuple[str, int]]:
    """Returns how many records each reason left out, most frequent first."""
    kinds = Counter(record["reason"].split(":")[0] for record in bad)
    return kinds.most_common()


def prepare(
    inputs: Sequence[Input],
    out: pathlib.Path,
    config: PackConfig,
    strict: bool = False,
    tick: Tick = lambda num_inputs, num_scenarios: None,
    num_workers: int = 1,
) -> Summary:
    """Makes a store of files or generated scenarios, or finishes one that was begun.

    Args:
        inputs: files of any known format, and ranges of seeds of the generator.
        out: the folder of the store; made if it is not there.
        config: how scenarios are packed.
        strict: whether the first bad record ends the run.
        tick: called now and then with the inputs (a seed counts as one) and scenarios
            done.
        num_workers: processes that make shards, which are the same for any number.

    Raises:
        RecordError: on the first bad record of a strict run, or if no record is usable;
            then nothing is left behind but what an earlier run had finished.
        FileExistsError: if the folder holds something else, or a store of other inputs,
            settings or versions.
        StoreError: if the plan of an earlier run is damaged.
        WorkerError: if a worker was killed.
    """
    is_new = plans.claim(out, plans.plan_of(inputs, config))
    jobs = [
        Job(out / f"shard-{number:05d}.array_record", group, config, strict)
        for number, group in enumerate(_groups(inputs))
    ]
    try:
        made, num_continued = _make(jobs, tick, num_workers)
        total = tallies.total([shard.tally for shard in made])
        _require_usable(total, inputs, strict)
    except RecordError:
        if is_new:
            _clear(out)
        raise
    store.write_json(out / store.MANIFEST, _manifest(jobs, made, total, config))
    return Summary(
        num_scenarios=total.num_scenarios,
        num_shards=len(made),
        num_continued=num_continued,
        num_bytes=total.num_bytes,
        num_coarse=total.num_coarse,
        share_index_dropped=total.num_index_dropped
        / max(total.num_index_dropped + total.num_index_listed, 1),
        bad=total.bad,
        duplicates=_duplicates(jobs, made, total),
    )


def _require_usable(total: Tally, inputs: Sequence[Input], strict: bool) -> None:
    """Raises if a strict run met a bad record, or there is no scenario."""
    if strict and total.bad:
        record = total.bad[0]
        raise RecordError(
            f"{record['file']}, record {record['record']}: {record['reason']}"
        )
    if not total.num_scenarios:
        nothing = {"file": inputs[0], "reason": "it has no record"}
        first = total.bad[0] if total.bad else nothing
        raise RecordError(
            f"no usable scenario in {len(inputs)} files; the first record left out "
            f"is of {first['file']}: {first['reason']}"
        )


def _duplicates(jobs: Sequence[Job], made: Sequence[Made], total: Tally) -> list[str]:
    """Returns the ids that came more than once, from the lists that have some."""
    repeated = total.repeated()
    found: dict[str, None] = {}
    for job, shard in zip(jobs, made, strict=True):
        if np.isin(shard.tally.id_hashes, repeated).any():
            names = [
                e["scenario_id"] for e in store.read_json(job.listing)["scenarios"]
            ]
            is_repeated = np.isin(tallies.hashes(names), repeated)
            found |= dict.fromkeys(itertools.compress(names, is_repeated))
    return list(found)


def _manifest(
    jobs: Sequence[Job], made: Sequence[Made], total: Tally, config: PackConfig
) -> dict[str, Any]:
    return {
        "format_version": store.FORMAT_VERSION,
        "versions": plans.versions(),
        "pack": dataclasses.asdict(config),
        "num_scenarios": total.num_scenarios,
        "num_bad_records": len(total.bad),
        "datasets": dict(total.datasets),
        "route_sources": dict(total.route_sources),
        "shards": [
            {"name": job.path.name, "sha256": shard.sha256}
            for job, shard in zip(jobs, made, strict=True)
        ],
    }


def _groups(inputs: Sequence[Input]) -> Iterator[list[Input]]:
    """Yields the inputs of each shard: the same inputs make the same shards.

    However many workers there are, small sets make small shards, so that they share
    them.
    """
    most = min(1.0, max(LEAST, sum(map(_share, inputs)) / FEW_SHARDS))
    group: list[Input] = []
    share = 0.0
    for item in (part for whole in inputs for part in _parts(whole, most)):
        group.append(item)
        share += _share(item)
        if share >= most:
            yield group
            group, share = [], 0.0
    if group:
        yield group


def _share(item: Input) -> float:
    """Returns how much of a full shard an input makes."""
    if isinstance(item, range):
        return len(item) / SHARD_SEEDS
    return item.stat().st_size / SHARD_BYTES


def _parts(item: Input, most: float) -> Iterator[Input]:
    if isinstance(item, range):
        step = math.ceil(SHARD_SEEDS * most)
        yield from (item[i : i + step] for i in range(0, len(item), step))
    else:
        yield item


def _make(jobs: Sequence[Job], tick: Tick, num_workers: int) -> tuple[list[Made], int]:
    """Makes the shards that are not there yet.

    Returns:
        All shards, and how many were there.
    """
    made: dict[int, Made] = {}
    count = _Count(tick)
    for number, job in enumerate(jobs):
        if (shard := shards.finished(job)) is not None:
            made[number] = shard
            count.add(number, _num_inputs(job), shard.tally.num_scenarios)
    num_continued = len(made)
    rest = [number for number in range(len(jobs)) if number not in made]
    if num_workers > 1 and len(rest) > 1:
        made |= _in_parallel(jobs, rest, count, min(num_workers, len(rest)))
    else:
        for number in rest:
            made[number] = _one(jobs[number], number, count.add)
    return [made[number] for number in range(len(jobs))], num_continued


def _one(job: Job, number: int, add: Callable[[int, int, int], None]) -> Made:
    """Makes one shard; `add` learns its number and what is done of it."""
    sizes = [len(item) if isinstance(item, range) else 0 for item in job.inputs]
    seeds_before = [sum(sizes[:i]) for i in range(len(sizes))]

    def tick(num_inputs: int, num_scenarios: int) -> None:
        is_seeds = bool(sizes[num_inputs])
        done = num_scenarios if is_seeds else num_inputs + seeds_before[num_inputs]
        add(number, done, num_scenarios)

    shard = shards.make(job, tick)
    add(number, _num_inputs(job), shard.tally.num_scenarios)
    return shard


def _num_inputs(job: Job) -> int:
    return sum(len(i) if isinstance(i, range) else 1 for i in job.inputs)


class _Count:
    """Adds up what is done of all shards."""

    def __init__(self, tick: Tick):
        self._tick = tick
        self._done: dict[int, tuple[int, int]] = {}
        self._total = [0, 0]

    def add(self, number: int, num_inputs: int, num_scenarios: int) -> None:
        """Notes what is done of one shard."""
        before = self._done.get(number, (0, 0))
        if (num_inputs, num_scenarios) <= before:
            return  # news from a worker that came late
        self._done[number] = (num_inputs, num_scenarios)
        self._total[0] += num_inputs - before[0]
        self._total[1] += num_scenarios - before[1]
        self.say()

    def say(self) -> None:
        """Tells the sums."""
        self._tick(*self._total)


def _in_parallel(
    jobs: Sequence[Job], numbers: Sequence[int], count: _Count, num_workers: int
) -> dict[int, Made]:
    news = workers.CONTEXT.Queue()
    with workers.pool(num_workers, _listen, news) as pool:
        futures = {
            pool.submit(_work, jobs[number], number): number for number in numbers
        }
        waiting = set(futures)
        while waiting:
            done, waiting = concurrent.futures.wait(
                waiting, PATIENCE, concurrent.futures.FIRST_EXCEPTION
            )
            _tell(news, count)
            count.say()  # so that whoever listens may end the work
            for future in done:
                shard, number = future.result(), futures[future]  # or what it raised
                # What the worker said last may still be on its way.
                count.add(number, _num_inputs(jobs[number]), shard.tally.num_scenarios)
    return {number: future.result() for future, number in futures.items()}


def _tell(news: Any, count: _Count) -> None:
    """Passes on what the workers have done since the last look."""
    while True:
        try:
            count.add(*news.get_nowait())
        except queue.Empty:
            return


def _listen(news: Any) -> None:
    globals()["_news"] = news


def _work(job: Job, number: int) -> Made:
    return _one(job, number, lambda *found: globals()["_news"].put(found))


def _clear(out: pathlib.Path) -> None:
    """Takes back what `prepare` wrote."""
    for path in [out / plans.PLAN, *out.glob("shard-*")]:
        path.unlink(missing_ok=True)
    out.rmdir()
