"""Feeds a training run: brings its scenarios onto the devices and exchanges them."""

import abc
import dataclasses
import functools
import hashlib
import json
import pathlib
import time
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh

from ..learners import mesh as meshes, strata
from ..learners.base import TrainState
from ..learners.program import compile_replacement
from ..sim.data import dealing, store
from ..sim.data.bank import Bank, total_bytes
from ..sim.data.loader import Source
from ..sim.data.stream import Part, Stream, StreamConfig
from . import banks


class Feed(abc.ABC):
    """What a training run drives on."""

    bank: Bank  # every leaf sharded along a leading axis of devices
    identity: Mapping[str, str]  # equal for runs on the same scenarios
    layout: Mapping[str, int]  # equal for runs whose worlds fit to the bank as they are

    @abc.abstractmethod
    def describe(self) -> str:
        """Returns a line about what is on the devices."""

    @abc.abstractmethod
    def restore(self, state: Mapping[str, Any]) -> None:
        """Goes on where a run of the same layout was that had this state."""

    @abc.abstractmethod
    def redeal(
        self, train_state: TrainState, fresh: TrainState, before: Mapping[str, int]
    ) -> tuple[TrainState, str]:
        """Fits the train state of a run of another layout to the devices here.

        Args:
            train_state: of that run.
            fresh: one that begins here.
            before: the layout of that run.

        Returns:
            The train state, and what became of its worlds, to be told.
        """

    @abc.abstractmethod
    def state(self) -> Mapping[str, Any]:
        """Returns what `restore` needs, as JSON can hold it."""

    @abc.abstractmethod
    def begin(self, done: int) -> None:
        """Copies what comes next to the devices while the program runs.

        Args:
            done: updates after the call that runs.
        """

    @abc.abstractmethod
    def exchange(self) -> dict[str, float]:
        """Puts what has come into the bank, between two calls of the program.

        Returns:
            What it cost, to be logged; empty where nothing was exchanged.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Ends what runs beside the program."""


def open_feed(
    source: Source,
    config: StreamConfig,
    max_objects: int,
    mesh: Mesh,
    num_strata: int,
    seed: int,
    saved: Mapping[str, Any] | None = None,
) -> Feed:
    """Brings scenarios onto the devices: all of them, or pages of a store.

    Args:
        source: the scenarios.
        config: whether and how they stream. Each process draws from a share of its own.
        max_objects: of a scenario, those that matter most to the ego.
        mesh: of the devices.
        num_strata: of the learner, into which what does not stream is divided.
        seed: of the order in which scenarios stream.
        saved: what a run that goes on kept: a feed's `identity` and, as `layout` and
            `feed`, its `layout` and `state`. If the first two are the same, the feed
            begins there; `restore` would fill the bank once more.

    Raises:
        FileNotFoundError: if there is no such store or file.
        ValueError: if there is no usable scenario, or they cannot be so divided.
    """
    if config.resident is None:
        deal = functools.partial(dealing.by_stratum, num_strata=num_strata)
        return Resident(banks.load(source, max_objects, mesh, deal))
    part = Part(process=jax.process_index(), num_processes=jax.process_count())
    num_devices = len(mesh.local_devices)
    stream = Stream(source, config, max_objects, num_devices, seed, part)
    return Streaming(stream, config, mesh, _digest_of(source), saved)


def _digest_of(source: Source) -> str:
    """Returns a hash of a store and of which of its scenarios are wanted."""
    shards = store.read_manifest(pathlib.Path(source.path))["shards"]
    wanted = dataclasses.replace(source, path="")
    text = repr(([shard["sha256"] for shard in shards], wanted))
    return hashlib.sha256(text.encode()).hexdigest()


class Resident(Feed):
    """All scenarios, on the devices for good."""

    def __init__(self, loaded: banks.Loaded):
        """Keeps what is loaded."""
        self.bank = loaded.bank
        self._loaded = loaded
        digests = np.zeros((loaded.num_scenarios, hashlib.sha256().digest_size), "u1")
        for number, scenario in loaded.scenarios.items():
            found = hashlib.sha256(store.encode(scenario)).digest()
            digests[number] = np.frombuffer(found, "u1")
        whole = meshes.largest(digests).tobytes()
        self.identity = {"scenarios": hashlib.sha256(whole).hexdigest()}
        self.layout = {"devices": loaded.num_devices}

    def describe(self) -> str:
        """Returns a line about the bank."""
        return banks.describe(self._loaded)

    def restore(self, state: Mapping[str, Any]) -> None:
        """Does nothing: the bank never changes."""

    def redeal(
        self, train_state: TrainState, fresh: TrainState, before: Mapping[str, int]
    ) -> tuple[TrainState, str]:
        """Tells the worlds where their scenarios lie; they go on as they would have."""
        worlds = strata.redeal(
            train_state.worlds,
            before["devices"],
            self._loaded.num_devices,
            axis=train_state.step.ndim,
        )
        return train_state.replace(worlds=worlds), "worlds go on as they were"

    def state(self) -> Mapping[str, Any]:
        """Returns nothing: the bank never changes."""
        return {}

    def begin(self, done: int) -> None:
        """Does nothing: nothing comes."""

    def exchange(self) -> dict[str, float]:
        """Does nothing: nothing has come."""
        return {}

    def close(self) -> None:
        """Does nothing: nothing runs."""


class Streaming(Feed):
    """Pages of a store, one of which is exchanged now and then."""

    def __init__(
        self,
        stream: Stream,
        config: StreamConfig,
        mesh: Mesh,
        digest: str,
        saved: Mapping[str, Any] | None,
    ):
        """Fills the bank."""
        self._stream, self._config, self._mesh = stream, config, mesh
        self._replace = compile_replacement()
        self._coming: tuple[int, Bank, float] | None = None
        self._state: Mapping[str, Any] = {}
        self.identity = {"scenarios": digest}
        self.layout = {"devices": mesh.size, "processes": jax.process_count()}
        same = {**self.identity, "layout": self.layout}
        is_same = saved is not None and same.items() <= saved.items()
        self._fill(saved["feed"] if saved is not None and is_same else None)

    def _fill(self, state: Mapping[str, Any] | None) -> None:
        own = None if state is None else state["of_processes"][jax.process_index()]
        self.bank = meshes.shard(self._mesh, self._stream.fill(own))
        self._state = self._stream.state

    def describe(self) -> str:
        """Returns a line about the bank and what streams through it."""
        num_bytes = total_bytes(self.bank)
        return (
            f"{self._config.resident:,} of {self._stream.num_scenarios:,} scenarios on "
            f"{self._mesh.size} device(s), {num_bytes / 1e6:,.1f} MB; one of "
            f"{self._config.pages} pages replaced every "
            f"{self._config.updates_per_page:,} updates"
        )

    def restore(self, state: Mapping[str, Any]) -> None:
        """Goes on where a run was that had this state."""
        if state["of_processes"][jax.process_index()] != self._state:
            self._fill(state)

    def redeal(
        self, train_state: TrainState, fresh: TrainState, before: Mapping[str, int]
    ) -> tuple[TrainState, str]:
        """Begins worlds anew: the stream does, and theirs are not here any more."""
        told = "the stream, worlds and replay begin anew"
        return train_state.replace(worlds=fresh.worlds), told

    def state(self) -> Mapping[str, Any]:
        """Returns which records are in the bank of each process, and which come."""
        states = meshes.gathered(json.dumps(self._state))
        return {"of_processes": [json.loads(state) for state in states]}

    def begin(self, done: int) -> None:
        """Sends the next page to the devices, if it is due."""
        if done % self._config.updates_per_page == 0:
            began = time.perf_counter()
            page = self._stream.take()
            waited = time.perf_counter() - began
            self._coming = page.number, meshes.shard(self._mesh, page.bank), waited
            self._state = page.state

    def exchange(self) -> dict[str, float]:
        """Puts the page that came in the place of the oldest."""
        if self._coming is None:
            return {}
        (number, page, waited), self._coming = self._coming, None
        began = time.perf_counter()
        self.bank = self._replace(self.bank, page, jnp.int32(number))
        jax.block_until_ready(self.bank)
        stalled = time.perf_counter() - began
        return {"page_wait_ms": 1e3 * waited, "page_stall_ms": 1e3 * stalled}

    def close(self) -> None:
        """Ends the thread that makes pages."""
        self._stream.close()
