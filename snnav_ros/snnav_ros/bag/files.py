"""Write a file whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from snnav_ros.bag.errors import BagError, one_line

__all__ = ["write_atomically", "write_text"]

Result = TypeVar("Result")


def write_atomically(path: str | Path, write: Callable[[Path], Result]) -> Result:
    """Let `write` make a file under another name (same ending) and move it to `path` when it is complete.

    Raises
    ------
    BagError
        If the folder cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise BagError(f"{path}: is a directory; give the name of a file")
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}.", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise BagError(f"{path}: cannot be written ({one_line(error)}); choose a writable place") from None
    os.close(handle)
    draft = Path(name)
    try:
        result = write(draft)
        draft.chmod(0o644)
        draft.replace(path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
    return result


def write_text(path: str | Path, text: str) -> None:
    """Write a text file (UTF-8), whole or not at all."""
    write_atomically(path, lambda draft: draft.write_text(text, encoding="utf-8"))
