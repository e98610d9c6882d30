"""Writes files so that they are whole or absent, whenever the process is killed."""

import os
import pathlib


def write_whole(path: str | os.PathLike[str], text: str) -> None:
    """Writes a text file beside its place and moves it there when it is complete."""
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    with part.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(part, path)
