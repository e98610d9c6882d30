"""Writes files so that they are whole or absent, and says where they may lie."""

import os
import pathlib
import tempfile


def write_whole(path: str | os.PathLike[str], content: str | bytes) -> None:
    """Writes a file beside its place and moves it there when it is complete."""
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    try:
        with part.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except OSError:
        part.unlink(missing_ok=True)
        raise


def cache_folder() -> pathlib.Path:
    """Returns the folder of what can be made again, such as compiled programs."""
    root = os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache"
    return pathlib.Path(root) / "drivetrain"


def require_writable(path: pathlib.Path) -> None:
    """Checks, before the work is done, that a file or folder can be made.

    Raises:
        ValueError: if the nearest of the folders above that is there is none, or may
            not be written to.
    """
    folder = path.absolute().parent
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir():
        raise ValueError(f"'{folder}' is no folder; name another place for '{path}'")
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise ValueError(
            f"'{folder}' may not be written to; name another place for '{path}'"
        ) from error
