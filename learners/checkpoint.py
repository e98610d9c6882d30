"""Saves and restores checkpoints: arrays of any tree, and metadata.

The format on disk is Orbax's, which commits a step by renaming its folder: a save cut
short leaves no step. What Orbax does not notice (a flipped bit) the hashes do that lie
beside the folder; a step without them is not finished. With several processes each
writes what it holds, and the first one alone says what is finished and what is damaged.
"""

import concurrent.futures
import contextlib
import dataclasses
import logging
import pathlib
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from . import checksums, mesh as meshes, snapshot
from .snapshot import Tree

logger = logging.getLogger(__name__)

NONE = -1  # in place of a step
# Of the metadata of a step, how good it is, less being better; None: not measured.
Rank = Callable[[Mapping[str, Any]], float | None]


class SaveError(OSError):
    """A step that could not be saved; those before it are as they were."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Restored:
    """What a checkpoint held."""

    step: int
    tree: Tree
    metadata: dict[str, Any]


class Checkpoints:
    """The checkpoints of one run: a directory with one folder per step.

    Any number of runs may read; one may write.
    """

    def __init__(
        self,
        directory: pathlib.Path,
        keep: int = 3,
        rank: Rank | None = None,
        keep_best: int = 1,
    ):
        """Opens a directory, which need not exist yet.

        Args:
            directory: where the folders are.
            keep: how many of the newest to keep.
            rank: tells how good a step is; None: there are no best ones.
            keep_best: how many of the best to keep besides.

        Raises:
            ValueError: if none were to be kept.
        """
        if keep < 1:
            raise ValueError(f"keep must be at least 1, got {keep}.")
        self._directory = directory.absolute()
        self._keep = keep
        self._rank = rank
        self._keep_best = keep_best
        self._damaged: set[int] = set()
        self._thread = concurrent.futures.ThreadPoolExecutor(1, "drivetrain-save")
        self._pending: concurrent.futures.Future[None] | None = None

    def steps(self) -> list[int]:
        """Lists the steps that were saved and not found damaged, in order."""
        return sorted(
            step
            for step in set(self._whole()) - self._damaged
            if checksums.exist(self._folder(step))
        )

    def best(self) -> list[int]:
        """Lists the steps of a known rank, the best first; of equals the newest."""
        ranks = {step: self._rank_of(step) for step in reversed(self.steps())}
        ranked = {step: rank for step, rank in ranks.items() if rank is not None}
        return sorted(ranked, key=ranked.__getitem__)

    def _rank_of(self, step: int) -> float | None:
        known = self.metadata_of(step)
        return None if self._rank is None or known is None else self._rank(known)

    def saved(self) -> list[int]:
        """Lists the steps when no save is under way any more, as `steps` does."""
        self._settle()
        return self.steps()

    def save(self, step: int, tree: Tree, metadata: Mapping[str, Any]) -> None:
        """Saves a step and returns when it is on disk; raises as `save_async` does."""
        self.save_async(step, tree, metadata)
        self.wait()

    def save_async(self, step: int, tree: Tree, metadata: Mapping[str, Any]) -> None:
        """Copies the arrays to the host, and writes them while the caller goes on.

        A save under way is waited for; if it fails, a warning says so, and this one is
        the next try. Steps that `restore` found damaged are renamed to `STEP.damaged`,
        those without hashes to `STEP.unfinished`, so that they do not stand before what
        is saved now.

        Args:
            step: after every step saved before.
            tree: arrays; its structure itself is not saved.
            metadata: values that JSON can hold.

        Raises:
            ValueError: if the step is not after the newest one.
            TypeError: if a leaf is no array, or JSON cannot hold the metadata.
        """
        self._settle()
        newest = max(self.steps(), default=NONE)
        if step <= newest:
            raise ValueError(
                f"step {step} is not after step {newest}, the newest in "
                f"{self._directory}; restore it first, or save to another directory."
            )
        try:
            with self._explained(step):
                if meshes.is_first():
                    self._make_way()
                written = snapshot.write_async(self._folder(step), tree, metadata)
        except SaveError as error:
            self._pending = concurrent.futures.Future()
            self._pending.set_exception(error)
        else:
            self._pending = self._thread.submit(self._finish, step, written)

    def wait(self) -> None:
        """Waits for the save under way, if any.

        Raises:
            SaveError: if it fails.
        """
        pending, self._pending = self._pending, None
        if pending is not None:
            pending.result()

    def _settle(self) -> None:
        try:
            self.wait()
        except SaveError as error:
            logger.warning("%s", error)

    def metadata(self) -> dict[str, Any] | None:
        """Returns what the newest step says of itself, before its hashes are checked.

        None if there is no step, or it says nothing that can be read.
        """
        newest = self.saved()[-1:]
        return self.metadata_of(newest[0]) if newest else None

    def metadata_of(self, step: int) -> dict[str, Any] | None:
        """Returns what a step says of itself, unchecked, if that can be read."""
        try:
            return snapshot.metadata(self._folder(step))
        except Exception:  # whatever a reader meets in damaged bytes
            return None

    def damage(self, step: int) -> str | None:
        """Reads a step, and says what is wrong with it; None if nothing is."""
        return checksums.damage(self._folder(step))

    def folders(self) -> list[pathlib.Path]:
        """Lists what is there by step: finished or not, and `STEP.damaged`."""
        if not self._directory.is_dir():
            return []
        found = [path for path in self._directory.iterdir() if path.is_dir()]
        named = [path for path in found if path.name.partition(".")[0].isdecimal()]
        return sorted(named, key=lambda path: (int(path.name.partition(".")[0]), path))

    def restore(self, like: Tree) -> Restored:
        """Restores the newest step that is what was saved; warns of each that is not.

        Args:
            like: a tree of the same structure, shapes and types, such as a fresh train
                state; each array is put where the one here is.

        Raises:
            FileNotFoundError: if there is no undamaged step.
            ValueError: if the step holds other arrays than `like`.
        """
        return self.restore_part(like, "")

    def restore_part(
        self, like: Tree, prefix: str, steps: Sequence[int] | None = None
    ) -> Restored:
        """Restores a part of the tree that was saved, and leaves the rest.

        Args:
            like: of the structure, shapes and types of the part.
            prefix: with which its arrays begin, such as `.params`.
            steps: to try, one after another; None: all, the newest first.

        Raises:
            FileNotFoundError: if there is no undamaged step.
            ValueError: if the part of the step holds other arrays than `like`.
        """
        self._settle()
        steps = self.steps()[::-1] if steps is None else steps
        step = self._first_undamaged(steps) if meshes.is_first() else NONE
        step = int(meshes.largest(np.array(step)))  # the others say NONE
        if step == NONE:
            raise FileNotFoundError(
                f"no undamaged checkpoint in {self._directory}; bring one back from a "
                "copy, or train into another folder with --out"
            )
        folder = self._folder(step)
        return Restored(
            step=step,
            tree=snapshot.read(folder, like, prefix),
            metadata=snapshot.metadata(folder),
        )

    def _folder(self, step: int) -> pathlib.Path:
        return self._directory / str(step)

    def _whole(self) -> list[int]:
        """Lists the steps that Orbax has committed."""
        names = [path.name for path in self.folders()]
        return [int(name) for name in names if name.isdecimal()]

    def _first_undamaged(self, steps: Sequence[int]) -> int:
        for step in steps:
            error = self.damage(step)
            if error is None:
                return step
            self._damaged.add(step)
            logger.warning(
                "DAMAGED CHECKPOINT: %s is not what was saved (%s); falling back to "
                "the next one.",
                self._folder(step),
                error,
            )
        return NONE

    def _finish(self, step: int, written: Callable[[], None]) -> None:
        """Waits until a step is on disk, notes its hashes, and deletes what is old."""
        with self._explained(step):
            written()
            if meshes.is_first():
                checksums.write(self._folder(step))
                kept = {*self.steps()[-self._keep :], *self.best()[: self._keep_best]}
                for old in set(self.steps()) - kept:
                    self._delete(old)

    @contextlib.contextmanager
    def _explained(self, step: int) -> Iterator[None]:
        try:
            yield
        except TypeError:  # of what is no array
            raise
        except Exception as error:  # whatever a full or lost disk makes Orbax raise
            raise SaveError(
                f"update {step:,} was not saved in '{self._directory}': "
                f"{str(error)[:200]}; make room there, or give back the right to write"
            ) from error

    def _make_way(self) -> None:
        """Sets aside what is not as it was saved, and deletes what cut saves left."""
        self._directory.mkdir(parents=True, exist_ok=True)
        for damaged in sorted(self._damaged):
            aside = self._directory / f"{damaged}.damaged"
            shutil.rmtree(aside, ignore_errors=True)
            self._folder(damaged).rename(aside)
            checksums.remove(self._folder(damaged))
        self._damaged.clear()
        for unfinished in sorted(set(self._whole()) - set(self.steps())):
            aside = self._directory / f"{unfinished}.unfinished"
            shutil.rmtree(aside, ignore_errors=True)
            self._folder(unfinished).rename(aside)
            logger.warning(
                "%s has no hashes beside it; set aside as %s.",
                self._folder(unfinished),
                aside.name,
            )
        for unfinished in self._directory.glob("*.orbax-checkpoint-tmp*"):
            shutil.rmtree(unfinished)

    def _delete(self, step: int) -> None:
        checksums.remove(self._folder(step))
        shutil.rmtree(self._folder(step))
