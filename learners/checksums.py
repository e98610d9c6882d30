"""Tells whether the files of a folder are those that were written.

The hashes lie beside it, in the format of `sha256sum`, which can check them too.
"""

import hashlib
import pathlib

from ..sim import files

SUFFIX = ".sha256"


def write(folder: pathlib.Path) -> None:
    """Writes the hashes of all files in a folder, whole or not at all."""
    lines = [f"{_hash(folder / name)}  {folder.name}/{name}" for name in _names(folder)]
    files.write_whole(_beside(folder), "".join(f"{line}\n" for line in lines))


def exist(folder: pathlib.Path) -> bool:
    """Tells whether hashes were written of a folder."""
    return _beside(folder).is_file()


def remove(folder: pathlib.Path) -> None:
    """Deletes the hashes of a folder, if there are any."""
    _beside(folder).unlink(missing_ok=True)


def damage(folder: pathlib.Path) -> str | None:
    """Says what is wrong with the files of a folder; None if they are as written."""
    try:
        lines = _beside(folder).read_text("ascii").splitlines()
        written = {name: digest for digest, _, name in map(_parted, lines)}
        names = _names(folder)
    except (OSError, UnicodeDecodeError) as error:
        return f"its hashes cannot be read: {error}"
    there = {f"{folder.name}/{name}" for name in names}
    if lacking := sorted(written.keys() - there):
        return f"{lacking[0]} is missing"
    if added := sorted(there - written.keys()):
        return f"{added[0]} has no hash"
    for name in names:
        listed = f"{folder.name}/{name}"
        try:
            found = _hash(folder / name)
        except OSError as error:
            return f"{listed} cannot be read: {error}"
        if found != written[listed]:
            return f"the hash of {listed} differs"
    return None


def _beside(folder: pathlib.Path) -> pathlib.Path:
    return folder.with_name(folder.name + SUFFIX)


def _names(folder: pathlib.Path) -> list[str]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return sorted(path.relative_to(folder).as_posix() for path in paths)


def _parted(line: str) -> tuple[str, str, str]:
    return line.partition("  ")


def _hash(path: pathlib.Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
