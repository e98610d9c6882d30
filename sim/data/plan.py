"""States what a store is made of, so that another run continues it or refuses to."""

import dataclasses
import importlib.metadata
import pathlib
from collections.abc import Sequence
from typing import Any

from . import store
from .inputs import Input
from .pack import PackConfig

PLAN = "plan.json"
VERSIONS = ("drivetrain", "numpy", "array-record", "pyarrow")


def plan_of(inputs: Sequence[Input], config: PackConfig) -> dict[str, Any]:
    """Returns what a store is made of: equal plans make equal shards.

    A file counts as the same while its size and the time of its last change are.
    """
    return {
        "format_version": store.FORMAT_VERSION,
        "versions": versions(),
        "pack": dataclasses.asdict(config),
        "inputs": [_named(item) for item in inputs],
    }


def versions() -> dict[str, str]:
    """Returns the versions of the packages that decide what a store holds."""
    found = {}
    for name in VERSIONS:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:  # an extra
            found[name] = "none"
    return found


def _named(item: Input) -> list[Any]:
    if isinstance(item, range):
        return [f"synthetic:{item.start}:{len(item)}", len(item), 0]
    stat = item.stat()
    return [str(item.resolve()), stat.st_size, stat.st_mtime_ns]


def claim(out: pathlib.Path, plan: dict[str, Any]) -> bool:
    """Makes the folder of a store, or checks that an earlier run made it so.

    Returns:
        Whether the store is new.

    Raises:
        FileExistsError: if the folder holds something else, or a store of another plan.
        StoreError: if its plan is damaged.
    """
    path = out / PLAN
    if path.is_file():
        _require_same(_read(path), plan, out)
        return False
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FileExistsError(f"'{out}' is there and no store; name a new folder")
    out.mkdir(parents=True, exist_ok=True)
    store.write_json(path, plan)
    return True


def _read(path: pathlib.Path) -> dict[str, Any]:
    try:
        plan = store.read_json(path)
        if not isinstance(plan["pack"], dict) or not all(map(len, plan["inputs"])):
            raise ValueError("it tells no settings or no inputs")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise store.StoreError(
            f"'{path}' is damaged ({error}); delete the folder '{path.parent}' and run "
            "prepare again"
        ) from error
    return plan


def _require_same(
    earlier: dict[str, Any], plan: dict[str, Any], out: pathlib.Path
) -> None:
    """Raises unless both plans are equal; the sentence says in what they differ."""
    cure = "name another folder, or delete this one first"
    for name, what in (("format_version", "format"), ("versions", "versions")):
        if earlier.get(name) != plan[name]:
            raise FileExistsError(
                f"'{out}' holds a store that another version began ({what} "
                f"{earlier.get(name)}, now {plan[name]}); {cure}"
            )
    before, now = earlier["inputs"], plan["inputs"]
    differences = _settings(earlier["pack"], plan["pack"]) + _files(before, now)
    if differences:
        raise FileExistsError(
            f"'{out}' holds a store of other files or settings: "
            f"{', '.join(differences)}; {cure}"
        )
    for (name, *was), (_, *fact) in zip(before, now, strict=True):
        if was != fact:
            raise FileExistsError(
                f"'{name}' has changed since the store '{out}' was begun; {cure}"
            )


def _settings(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Says which settings differ, those of a section by dotted names."""
    found = []
    for name in before | now:
        was, fact = before.get(name), now.get(name)
        if isinstance(was, dict) and isinstance(fact, dict):
            found += [f"{name}.{each}" for each in _settings(was, fact)]
        elif was != fact:
            found.append(f"{name} was {was}, now {fact}")
    return found


def _files(before: Sequence[Sequence[Any]], now: Sequence[Sequence[Any]]) -> list[str]:
    """Says which inputs are new, gone or in another order."""
    was, names = ([name for name, *_ in inputs] for inputs in (before, now))
    if was == names:
        return []
    found = []
    for word, some, others in (
        ("new", names, set(was)),
        ("gone", was, set(names)),
    ):
        rest = [name for name in some if name not in others]
        if rest:
            found.append(f"{len(rest):,} {word}, such as '{rest[0]}'")
    return found or ["the order of the files"]
