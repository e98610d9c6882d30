"""Checks, before the work is done, that its results can be written."""

import pathlib
from collections.abc import Mapping

from ..sim import files


def require(
    outputs: Mapping[str, pathlib.Path | None], folder: pathlib.Path | None = None
) -> None:
    """Checks that files, by option, and a folder can be written.

    Raises:
        ValueError: if one cannot.
    """
    if folder is not None and folder.exists() and not folder.is_dir():
        raise ValueError(f"'{folder}' is a file; name a folder to write to.")
    for option, out in outputs.items():
        if out is not None and out.is_dir():
            raise ValueError(f"--{option} '{out}' is a folder; name a file in it.")
    for out in (*outputs.values(), folder):
        if out is not None:
            files.require_writable(out)
