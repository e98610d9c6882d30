"""Keeps the ego's actions in a file, and drives by them again."""

import dataclasses
import io
import pathlib
import zipfile
import zlib

import numpy as np
from jaxtyping import Array, Int, PRNGKeyArray, Shaped

from ..sim import files
from ..sim.data.bank import Bank
from ..sim.dynamics import build as dynamics
from ..sim.dynamics.base import Action, Discrete
from ..sim.env.base import Driver, State
from ..sim.scene import Scene
from .banks import Loaded

RECORDED = "recorded"  # the name of the agent that drives by a file


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """What the ego did in each scenario, one after the other."""

    scenario_ids: tuple[str, ...]
    dynamics: str  # by name; says what an action is
    sim_agent: str  # by name; drove all others
    num_objects: int  # slots of a scenario, the ego's among them
    quantized: bool  # whether the bank's numbers have 16 bits
    actions: Shaped[np.ndarray, "scenarios steps *features"]  # from the first one on

    def require_fits(self, loaded: Loaded, source: str) -> None:
        """Checks that scenarios are those of the record, in their order.

        Raises:
            ValueError: if they are not.
        """
        ids = tuple(scenario.scenario_id for scenario in loaded.scenarios.values())
        num_steps, num_actions = loaded.bank.sizes.num_simulated, self.actions.shape[1]
        pairs = enumerate(zip(self.scenario_ids, ids, strict=False))
        other = [f"'{a}', not '{b}', as number {i}" for i, (a, b) in pairs if a != b]
        if len(ids) != len(self.scenario_ids):
            what = f"{len(self.scenario_ids)} scenarios, not {len(ids)}"
        elif other:
            what = other[0]
        elif num_actions != num_steps:
            what = f"{num_actions} steps, not {num_steps}"
        else:
            return
        raise ValueError(
            f"'{source}' was recorded on other data: it has {what}; give the --data, "
            "--split and --max-scenarios of the record"
        )

    def differences(self, loaded: Loaded, sim_agent: str) -> list[str]:
        """Says what else differs from when it was recorded, so that the rollout may."""
        pairs = {
            "--sim-agent": (self.sim_agent, sim_agent),
            "--max-objects": (self.num_objects, loaded.bank.sizes.num_objects),
            "--quantize": (self.quantized, is_quantized(loaded)),
        }
        return [
            f"{name} {now}, not {then}"
            for name, (then, now) in pairs.items()
            if now != then
        ]


def is_quantized(loaded: Loaded) -> bool:
    """Tells whether numbers of a bank have 16 bits."""
    return not np.issubdtype(loaded.bank.poses.dtype, np.floating)


def write(path: pathlib.Path, record: Record) -> None:
    """Writes an `.npz` archive of the fields, `scenario_ids` as `scenario_id`."""
    archive = io.BytesIO()
    np.savez_compressed(
        archive,
        scenario_id=np.array(record.scenario_ids),
        dynamics=np.array(record.dynamics),
        sim_agent=np.array(record.sim_agent),
        num_objects=np.array(record.num_objects),
        quantized=np.array(record.quantized),
        actions=record.actions,
    )
    files.write_whole(path, archive.getvalue())


def read(path: pathlib.Path) -> Record:
    """Reads what `write` has written.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is no record of actions.
    """
    try:
        # Files come from anywhere, and pickles run code.
        with np.load(path, allow_pickle=False) as archive:
            record = Record(
                scenario_ids=tuple(archive["scenario_id"].tolist()),
                dynamics=str(archive["dynamics"]),
                sim_agent=str(archive["sim_agent"]),
                num_objects=int(archive["num_objects"]),
                quantized=bool(archive["quantized"]),
                actions=archive["actions"],
            )
    except (
        ValueError,
        KeyError,
        TypeError,
        EOFError,
        NotImplementedError,
        zlib.error,
        zipfile.BadZipFile,
    ) as error:
        raise ValueError(
            f"'{path}' is no record of actions, or is damaged; make one with: "
            f"drivetrain evaluate AGENT --record {path}"
        ) from error
    spec = dynamics.build(record.dynamics).action_spec
    kind = np.integer if isinstance(spec, Discrete) else np.floating
    features = () if isinstance(spec, Discrete) else (len(spec.low),)
    shape = (len(record.scenario_ids), *record.actions.shape[1:2], *features)
    if record.actions.shape != shape or not np.issubdtype(record.actions.dtype, kind):
        raise ValueError(
            f"'{path}' holds actions of shape {record.actions.shape} and type "
            f"{record.actions.dtype}, which are none of {shape[0]} scenarios with "
            f"--dynamics {record.dynamics}; record it again"
        )
    if not np.all(np.isfinite(record.actions)):
        scenario, step = np.argwhere(~np.isfinite(record.actions))[0][:2]
        raise ValueError(
            f"'{path}' holds actions that are no numbers: in scenario "
            f"'{record.scenario_ids[scenario]}' from step {step} on; record it again"
        )
    return record


def driver_of(actions: Action, number: Int[Array, ""]) -> Driver:
    """Makes the driver of a scenario.

    Args:
        actions: of all scenarios and steps.
        number: of the scenario.
    """

    def reset(scene: Scene) -> Int[Array, ""]:
        return scene.current_step

    def act(
        start: Int[Array, ""], bank: Bank, state: State, key: PRNGKeyArray
    ) -> tuple[Int[Array, ""], Action]:
        del bank, key
        return start, actions.at[number, state.step - start].get(mode="clip")

    return Driver(reset, act)
