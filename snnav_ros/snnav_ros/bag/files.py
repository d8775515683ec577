"""Write a file or a directory whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from snnav_ros.bag.errors import BagError, one_line

__all__ = ["check_directory", "make_directory", "write_atomically", "write_text"]

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
        raise _not_writable(path, error) from None
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


def check_directory(directory: str | Path, mark: str) -> Path:
    """Return the path if results can be written there: it does not exist, is empty, or holds earlier results.

    Nothing is left behind: what takes minutes can ask before it begins.

    Raises
    ------
    BagError
        If it is a file, a directory with other files and without the file named `mark`, or in a place that cannot be
        written.
    """
    path = Path(directory)
    if path.exists() and not path.is_dir():
        raise BagError(f"{path}: is a file; give the name of a directory")
    if path.is_dir() and any(path.iterdir()) and not (path / mark).is_file():
        raise BagError(f"{path}: holds other files; give a new or an empty directory")
    try:
        above = next(folder for folder in path.absolute().parents if folder.exists())
        tempfile.TemporaryFile(dir=above).close()
    except OSError as error:
        raise _not_writable(path, error) from None
    return path


def _not_writable(path: Path, error: OSError) -> BagError:
    reason = error.strerror or one_line(error)
    return BagError(f"{path}: cannot be written ({reason}); choose a writable place")


def make_directory(directory: str | Path, mark: str, fill: Callable[[Path], None]) -> None:
    """Let `fill` write into a draft directory and move that to its place; earlier results there are replaced.

    Raises
    ------
    BagError
        If the directory holds something else, or cannot be written.
    """
    path = check_directory(directory, mark)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        workplace = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise _not_writable(path, error) from None
    try:
        (workplace / "new").mkdir()
        fill(workplace / "new")
        if path.exists():
            path.rename(workplace / "old")
        (workplace / "new").rename(path)
    finally:
        shutil.rmtree(workplace, ignore_errors=True)
