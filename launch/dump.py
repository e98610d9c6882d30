"""Writes what happened in each scenario to an archive of arrays."""

import io
import pathlib
import urllib.parse
from collections import Counter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..sim import files
from ..sim.data.bank import Bank
from ..sim.data.packed import Packed
from ..sim.env.recording import Recording, record
from .banks import Loaded
from .players import Player

MAX_NAME = 200  # characters of a file's name, of the 255 that file systems take


def recordings(player: Player, loaded: Loaded, seed: int, numbers: list[int]):
    """Yields scenarios by number, each with its recording, cut to its own steps."""

    @jax.jit
    def play(params: PyTree, bank: Bank, number) -> Recording:
        place, shard = jnp.divmod(number, loaded.num_devices)
        local_bank = jax.tree.map(lambda leaf: leaf[shard], bank)
        key = jax.random.fold_in(jax.random.key(seed), number)
        driver = player.driver_of(params, number)
        return record(player.env, driver, local_bank, place, key)

    for number in numbers:
        scenario = loaded.scenarios[number]
        recording = play(player.params, loaded.bank, jnp.int32(number))
        yield scenario, _cut(jax.device_get(recording), scenario, loaded)


def _cut(recording: Recording, scenario: Packed, loaded: Loaded) -> Recording:
    num_objects = min(len(scenario.object_id), loaded.bank.sizes.num_objects)

    def cut(leaf: np.ndarray) -> np.ndarray:
        leaf = leaf[: scenario.num_steps]
        return leaf[:, :num_objects] if leaf.ndim > 1 else leaf

    return jax.tree.map(cut, recording)


def arrays(scenario: Packed, recording: Recording) -> dict[str, np.ndarray]:
    """Returns the arrays of one scenario by name, places in the file's coordinates.

    `metric/NAME` means something where `metric_valid/NAME` is True.
    """
    motion = recording.motion
    num_objects = motion.valid.shape[1]
    out: dict[str, np.ndarray] = {
        "scenario_id": np.array(scenario.scenario_id),
        "object_id": scenario.object_id[:num_objects],
        "object_type": scenario.object_type[:num_objects],
        "size": scenario.object_size[:num_objects],
        "xy": np.where(
            motion.valid[..., None],
            motion.xyz[..., :2].astype(np.float64) + scenario.origin[:2],
            0.0,
        ),
        "yaw": np.asarray(motion.yaw),
        "velocity": np.asarray(motion.velocity),
        "valid": np.asarray(motion.valid),
        "ego_index": np.array(0),
        "current_step": np.array(scenario.current_step),
    }
    for name, measure in recording.measures.items():
        out[f"metric/{name}"] = np.asarray(measure.value)
        out[f"metric_valid/{name}"] = np.asarray(measure.valid)
    return out


def dump(player: Player, loaded: Loaded, seed: int, folder: pathlib.Path, tick) -> None:
    """Writes one `.npz` per scenario, named by its id; `.2` follows an id that repeats.

    Args:
        player: drives.
        loaded: the scenarios.
        seed: of the player's draws.
        folder: made if it is not there.
        tick: called after each scenario with the number done.
    """
    folder.mkdir(parents=True, exist_ok=True)
    numbers = list(range(len(loaded.scenarios)))
    played = recordings(player, loaded, seed, numbers)
    seen: Counter[str] = Counter()
    for done, (scenario, recording) in enumerate(played, start=1):
        # Ids come from files: quoted, none can lead out of the folder.
        name = urllib.parse.quote(scenario.scenario_id, safe=" ")[:MAX_NAME]
        seen[name] += 1
        if seen[name] > 1:
            name = f"{name}.{seen[name]}"
        archive = io.BytesIO()
        values: dict[str, Any] = arrays(scenario, recording)
        np.savez_compressed(archive, **values)
        files.write_whole(folder / f"{name}.npz", archive.getvalue())
        tick(done)
