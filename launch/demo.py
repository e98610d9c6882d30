"""Shows the whole way at work: trains, evaluates, prints the table, writes a report."""

import dataclasses
import importlib.resources
import pathlib
from collections import Counter
from collections.abc import Sequence

import numpy as np
from rich import console as rich_console

from ..learners import mesh as meshes
from ..sim import files
from ..sim.data import loader
from ..sim.data.packed import Packed
from ..sim.data.synthetic.generate import generate
from ..sim.env.recording import Recording
from ..sim.scenario import Scenario
from ..sim.visualization import scene as pictures
from ..sim.visualization.trajectory import Trajectory
from . import banks, config, dump, evaluate, logbook, report, runs, tables
from .banks import Loaded
from .experiment import Experiment
from .players import Player, rule, trained
from .train import train

UNSEEN = "synthetic:2000000:128"  # neither trained on nor tuned on
RULES = ("expert", "coast", "constant_speed")
SIM_AGENT = "playback"
NUM_PICTURES = 3


def demo(out: pathlib.Path, seed: int) -> None:
    """Trains `configs/demo.yaml` and evaluates it beside rules.

    Writes the run to `out`, with `table.json`, `rollouts.png` and `report.html`.

    Args:
        out: the folder of the run.
        seed: of the training.

    Raises:
        FileExistsError: if the folder holds another run.
    """
    console = rich_console.Console(highlight=False)
    experiment = _experiment(seed)
    train(experiment, out)

    source = loader.Source(path=UNSEEN)
    loaded = banks.load(source, experiment.max_objects, meshes.data_mesh())
    players = [rule(name, "bicycle", SIM_AGENT) for name in RULES]
    (learned,) = trained(out, SIM_AGENT, None, runs.NEWEST, loaded)
    players.append(dataclasses.replace(learned, name="bc"))
    rows = [evaluate.row(player, loaded, seed) for player in players]
    tables.show(rows, f"{len(loaded.scenarios)} generated scenarios not trained on")
    tables.write_json(out / "table.json", rows)

    drawn = _panels(players[-1], loaded, seed)
    files.write_whole(out / "rollouts.png", _png([panel for panel, _ in drawn]))
    report.write(
        out / "report.html",
        report.Report(
            title="Drivetrain demo",
            summary=f"A Wayformer driver, trained by imitation on {experiment.data} "
            f"for {experiment.updates:,} updates with seed {seed}, plays {UNSEEN}.",
            rows=rows,
            curves=[_learning_curve(out)],
            pictures=[
                report.Picture(png=_png([panel]), caption=caption)
                for panel, caption in drawn
            ],
            config=(out / runs.CONFIG).read_text(),
            facts=report.environment(),
        ),
    )
    console.print(f"report: {out / 'report.html'}   table: {out / 'table.json'}")


def _experiment(seed: int) -> Experiment:
    name = importlib.resources.files("drivetrain.configs") / "demo.yaml"
    with importlib.resources.as_file(name) as path:
        return config.load(path, Experiment, [f"seed={seed}"])


def _learning_curve(folder: pathlib.Path) -> report.Curve:
    lines = logbook.read(folder)
    return report.Curve(
        label="negative log-likelihood [nats]",
        steps=[line["step"] or 0 for line in lines],
        values=[line["loss"] for line in lines],
        step_label="updates",
    )


def _panels(
    player: Player, loaded: Loaded, seed: int
) -> list[tuple[pictures.Panel, str]]:
    """Returns some scenarios at the end of the log, each with its caption."""
    numbers = _of_each_kind(list(loaded.scenarios.values()))[:NUM_PICTURES]
    drawn = []
    for packed, recording in dump.recordings(player, loaded, seed, numbers):
        scenario = generate(int(packed.scenario_id.split("-")[1]))
        panel = pictures.Panel(
            title=packed.scenario_id,
            scenario=scenario,
            trajectory=_trajectory(scenario, packed, recording),
            step=scenario.num_steps - 1,
        )
        drawn.append((panel, _caption(packed, recording)))
    return drawn


def _of_each_kind(scenarios: Sequence[Packed]) -> list[int]:
    """Returns the numbers of the scenarios: the first of each kind, then the second."""
    seen: Counter[str] = Counter()
    turns = []
    for number, packed in enumerate(scenarios):
        kind = packed.scenario_id.split("-")[2]
        turns.append((seen[kind], number))
        seen[kind] += 1
    return [number for _, number in sorted(turns)]


def _png(panels: Sequence[pictures.Panel]) -> bytes:
    return pictures.to_png(pictures.figure(panels))


def _trajectory(scenario: Scenario, packed: Packed, recording: Recording) -> Trajectory:
    """Puts the objects of a recording into the order of their scenario."""
    arrays = dump.arrays(packed, recording)
    place = {object_id: i for i, object_id in enumerate(arrays["object_id"])}
    columns = np.array([place.get(i, -1) for i in scenario.tracks.object_id])

    is_ego = np.arange(len(columns)) == scenario.ego_index

    def ordered(name: str) -> np.ndarray:
        return arrays[name][:, columns]

    return Trajectory(
        xy=ordered("xy"),
        yaw=ordered("yaw"),
        valid=ordered("valid") & (columns >= 0),
        collision=(ordered("metric/collision") > 0) & is_ego,
        offroad=(ordered("metric/offroad") > 0) & is_ego,
    )


def _caption(packed: Packed, recording: Recording) -> str:
    after = slice(packed.current_step + 1, None)
    figures = {name: m.value[after] for name, m in recording.measures.items()}
    events = [
        word
        for name, word in (("collision", "collides"), ("offroad", "leaves the road"))
        if (figures[name][:, 0] > 0).any()
    ]
    displacement = recording.measures["log_displacement"]
    mean = float(displacement.value[after, 0][displacement.valid[after, 0]].mean())
    outcome = " and ".join(events) if events else "no collision, on the road"
    return f"{packed.scenario_id}: {outcome}; {mean:.1f} m from the log on average"
