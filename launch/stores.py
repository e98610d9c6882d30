"""Runs the commands that make stores of scenarios and say what is in them."""

import os
import pathlib
from typing import Annotated

import tyro
from rich import console as rich_console

from ..sim import files
from ..sim.data import inputs, loader, prepare as preparing, statistics, store
from ..sim.data.loader import Split
from ..sim.data.pack import PackConfig
from ..sim.data.timeline import Timeline
from . import comparison, histograms, interrupts, outputs, summary as summaries
from .progress import progress

MANY_DROPPED = 1e-3  # of the candidates for the nearest road edge, to be told
MAX_NAMED = 10  # records left out that are named, each with its reason


def prepare(
    paths: Annotated[
        tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILES… OUT")
    ],
    /,
    simplify: float = PackConfig.simplify,
    quantize: bool = PackConfig.quantize,
    timeline: Timeline = PackConfig.timeline,
    strict: bool = False,
    workers: int | None = None,
) -> None:
    """Makes a store of scenarios from files of driving logs.

    drivetrain prepare 'womd/*.tfrecord*' data/womd
    drivetrain prepare synthetic:0:10000 data/town

    Formats are told from the content, plain or gzip: WOMD Scenario and tf.Example
    TFRecords, WOMD JSON (Nocturne, GPUDrive), ScenarioNet pickles, Argoverse 2 (name
    the .parquet files), CommonRoad XML, PufferDrive .bin. A run that was cut continues
    where it was.

    Args:
        paths: files, quoted patterns of files or synthetic:FIRST:COUNT for generated
            scenarios, and last the folder of the store.
        simplify: how far simplified map lines may lie from the logged ones [m].
        quantize: keep 16-bit numbers (1 cm, 1 cm/s); else float32, and nothing is
            simplified.
        timeline: how logs come to steps of 0.1 s. other-rates: resample those of other
            steps, or refuse them. current-step: the last step of history, from which
            the simulation starts; by default as the format has it (10; 49 in
            Argoverse 2).
        strict: stop at the first record that cannot be used.
        workers: processes that share the work; by default one for each core.
    """
    if len(paths) < 2:
        raise ValueError(
            "prepare needs files and the folder of the store: drivetrain prepare "
            "'womd/*.tfrecord*' data/womd"
        )
    if workers is not None and workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}.")
    _require_folder(paths[-1])
    items = [item for text in paths[:-1] for item in inputs.inputs_of(text)]
    total = sum(len(item) if isinstance(item, range) else 1 for item in items)
    out = pathlib.Path(paths[-1])
    settings = PackConfig(simplify=simplify, quantize=quantize, timeline=timeline)
    num_workers = workers or os.cpu_count() or 1
    with (
        progress("preparing", total, unit="inputs") as line,
        interrupts.noted() as notice,
    ):

        def tick(done: int, num_scenarios: int) -> None:
            notice.check()
            line.update(done, f"{num_scenarios:,} scenarios")

        summary = preparing.prepare(items, out, settings, strict, tick, num_workers)
    _print_summary(summary, out)


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}" + ("" if count == 1 else "s")


def _print_summary(summary: preparing.Summary, out: pathlib.Path) -> None:
    console = rich_console.Console(highlight=False, markup=False, soft_wrap=True)
    mean = summary.num_bytes / summary.num_scenarios / 1e3
    console.print(
        f"{_counted(summary.num_scenarios, 'scenario')} in "
        f"{_counted(summary.num_shards, 'shard')} in {out}, {mean:.1f} KB each; "
        f"{len(summary.bad)} record(s) left out"
    )
    if summary.num_continued:
        console.print(f"{summary.num_continued} shard(s) were there already")
    for reason, count in summary.reasons():
        console.print(f"  {count} x {reason}")
    for bad in summary.bad[:MAX_NAMED]:
        console.print(f"  {bad['file']}, record {bad['record']}: {bad['reason']}")
    if len(summary.bad) > MAX_NAMED:
        console.print(
            f"  and {len(summary.bad) - MAX_NAMED:,} more, named in {out}/*.json"
        )
    if summary.num_coarse:
        console.print(
            f"{summary.num_coarse} scenario(s) are wider than 655 m and kept to more "
            "than 1 cm; --no-quantize keeps float32"
        )
    if summary.share_index_dropped >= MANY_DROPPED:
        console.print(
            f"{100 * summary.share_index_dropped:.1f} % of the candidates for the "
            "nearest road edge did not fit into cells of 1 m; in crowded ones an edge "
            "up to 1.4 m farther may count as the nearest"
        )
    if summary.duplicates:
        console.print(
            f"{len(summary.duplicates)} scenario id(s) came more than once, for "
            f"example {summary.duplicates[0]}"
        )


def summary(
    store_folder: Annotated[
        pathlib.Path, tyro.conf.Positional, tyro.conf.arg(metavar="STORE")
    ],
    /,
    json: pathlib.Path | None = None,
    plot: pathlib.Path | None = None,
    verify: bool = False,
) -> None:
    """Says what is in a store.

    drivetrain data summary data/womd --plot womd.png

    Counts by format with the sources of routes, distributions over scenarios, bytes in
    the bank and what all of WOMD would take, what formats left unsaid, the settings,
    records that were left out and why, ids that came more than once, and scenarios
    whose traffic lights look out of step with the tracks.

    Args:
        store_folder: made by `drivetrain prepare`.
        json: write the figures to this file.
        plot: draw the distributions to this file, a PNG.
        verify: read every shard and check its SHA-256 first.
    """
    _require_outputs(json, plot)
    _require_folder(str(store_folder))
    if verify:
        store.verify(store_folder)
    entries = store.entries(store_folder)
    manifest, bad = store.read_manifest(store_folder), store.bad_records(store_folder)
    figures = summaries.summarize(entries) | summaries.preparation(manifest, bad)
    console = rich_console.Console(highlight=False)
    console.print(summaries.dataset_table(figures))
    console.print(summaries.distribution_table(figures))
    for line in summaries.lines(figures) + summaries.preparation_lines(figures):
        console.print(line, markup=False)
    if json is not None:
        store.write_json(json, figures)
    if plot is not None:
        panels = {
            title: {store_folder.name: summaries.values(entries, name)}
            for name, title in summaries.DISTRIBUTIONS.items()
        }
        title = f"{store_folder}: {len(entries):,} scenarios"
        files.write_whole(plot, histograms.draw(panels, title=title))


def _require_outputs(json: pathlib.Path | None, plot: pathlib.Path | None) -> None:
    outputs.require({"json": json, "plot": plot})
    if plot is not None and plot.suffix.lower() != ".png":
        raise ValueError(f"--plot writes a PNG; name it '{plot.with_suffix('.png')}'.")


def _require_folder(text: str) -> None:
    """Raises if what should be the folder of a store is a text for scenarios."""
    if pathlib.Path(text).exists():
        return
    if text.startswith(inputs.SYNTHETIC) or any(mark in text for mark in "*?["):
        raise ValueError(
            f"'{text}' names scenarios, not the folder of a store; to make one of "
            f"them: drivetrain prepare '{text}' STORE"
        )


def compare(
    first: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="A")],
    second: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="B")],
    /,
    split: Split = "all",
    test_share: float = 1 / 3,
    json: pathlib.Path | None = None,
    plot: pathlib.Path | None = None,
) -> None:
    """Compares the traffic of two sources of scenarios.

    drivetrain data compare synthetic:0:1000 data/womd --plot traffic.png

    Args:
        first: a store, a file, a quoted pattern of files, or synthetic:FIRST:COUNT.
        second: likewise.
        split: which part of the second to look at, by a hash of the ids.
        test_share: of the scenarios that belongs to the split test.
        json: write a row for each quantity to this file.
        plot: draw the distributions to this file, a PNG.
    """
    _require_outputs(json, plot)
    comparison.require_two((first, second))
    both = (
        loader.Source(path=first),
        loader.Source(path=second, split=split, test_share=test_share),
    )
    counts = [loader.count(source) for source in both]  # both are there
    sources = {}
    for source, count in zip(both, counts, strict=True):
        with progress("reading", count, unit="scenarios") as line:
            found = loader.load(source, line.update, os.cpu_count() or 1)
        sources[source.path] = statistics.samples(found)
    rows = comparison.compare(sources)
    rich_console.Console(highlight=False).print(comparison.table(rows))
    if json is not None:
        store.write_json(json, rows)
    if plot is not None:
        files.write_whole(plot, comparison.draw(sources, rows))
