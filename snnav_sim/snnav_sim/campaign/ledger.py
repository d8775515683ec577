"""The directory of a campaign: what is run there, and which runs are done."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import snnav_core
import snnav_sim
from snnav_core.errors import InvalidInput
from snnav_sim.campaign.run import run_seed, write_whole
from snnav_sim.report.metrics import library_versions

__all__ = ["Campaign", "Ledger", "open_ledger"]

HEADER, RUNS = "campaign.json", "runs.jsonl"


@dataclass(frozen=True)
class Campaign:
    """What a campaign consists of: `runs` scenes of one kind; the seeds of the runs follow from `seed`."""

    kind: str
    runs: int
    seed: int

    @property
    def seeds(self) -> list[int]:
        """Seeds of the runs."""
        return [run_seed(self.seed, number) for number in range(self.runs)]


class Ledger:
    """The finished runs of a campaign, one line of JSON each, in the order in which they ended."""

    def __init__(self, campaign: Campaign, directory: Path, file: BinaryIO) -> None:
        self.campaign, self.directory, self._file = campaign, directory, file
        self._records = {int(record["seed"]): record for record in _read(directory / RUNS, campaign.kind)}

    @property
    def records(self) -> list[dict[str, Any]]:
        """The finished runs in order of their seeds."""
        return [self._records[seed] for seed in self.campaign.seeds if seed in self._records]

    @property
    def missing(self) -> list[int]:
        """Seeds of the runs that are still to be made."""
        return [seed for seed in self.campaign.seeds if seed not in self._records]

    def add(self, record: Mapping[str, Any]) -> None:
        """Append a finished run; it is on the disk when this returns."""
        line = json.dumps(record, allow_nan=False, ensure_ascii=False) + "\n"
        self._file.write(line.encode("utf-8"))
        self._file.flush()
        os.fsync(self._file.fileno())
        self._records[int(record["seed"])] = json.loads(line)


@contextmanager
def open_ledger(campaign: Campaign, directory: Path) -> Iterator[Ledger]:
    """Begin a campaign in a new or empty directory, or go on with the one that is there.

    Parameters
    ----------
    campaign : Campaign
        Of the same kind and seed as what is there; the number of runs may be another one.
    directory : path
        Made with its parents.

    Raises
    ------
    InvalidInput
        If something else stands there: other files, another campaign, one by other versions, one that is going on.
    """
    if directory.exists() and not directory.is_dir():
        raise InvalidInput(f"{directory}: is a file: give another directory for the campaign")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if not (directory / HEADER).exists():
            _begin(campaign, directory)
        else:
            _check(campaign, directory)
        file = (directory / RUNS).open("ab")
    except OSError as error:
        raise InvalidInput(
            f"{directory}: cannot be written ({error.strerror}): give another directory"
        ) from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InvalidInput(
                f"{directory}: a campaign is going on there: wait for its end or give another directory"
            ) from None
        _drop_half_line(directory / RUNS)
        yield Ledger(campaign, directory, file)


def _begin(campaign: Campaign, directory: Path) -> None:
    others = [entry.name for entry in directory.iterdir() if not entry.name.startswith(f".{HEADER}.")]
    if others:
        raise InvalidInput(
            f"{directory}: holds files of something else than a campaign ({min(others)}): give another or an "
            "empty directory"
        )
    write_whole(directory / HEADER, (json.dumps(_header(campaign), indent=2) + "\n").encode("utf-8"))


def _header(campaign: Campaign) -> dict[str, Any]:
    return {
        "kind": campaign.kind,
        "seed": campaign.seed,
        "versions": library_versions(),
        "sources": _sources_digest(),
    }


def _sources_digest() -> str:
    """Identify the program that computes the runs: its version number does not change with every change."""
    content = hashlib.sha256()
    for package in (snnav_core, snnav_sim):
        root = Path(package.__path__[0])
        for path in sorted(root.rglob("*.py")):
            content.update(path.relative_to(root).as_posix().encode("utf-8") + b"\0" + path.read_bytes())
    return content.hexdigest()[:16]


def _check(campaign: Campaign, directory: Path) -> None:
    """Refuse to mix runs of different campaigns or programs."""
    try:
        found = json.loads((directory / HEADER).read_text(encoding="utf-8"))
        differing = [key for key, value in _header(campaign).items() if found[key] != value]
    except (ValueError, KeyError, TypeError):
        raise InvalidInput(
            f"{directory / HEADER}: is damaged: give another directory for the campaign"
        ) from None
    for key in differing:
        if key in ("kind", "seed"):
            raise InvalidInput(
                f"{directory}: holds a campaign of --kind {found['kind']} --seed {found['seed']}: ask for that, or "
                "give another directory"
            )
        raise InvalidInput(
            f"{directory}: was begun by another program ({key} differ): give another directory, or go on with that one"
        )


def _drop_half_line(path: Path) -> None:
    """Cut what was being written when a campaign was killed; that run is repeated."""
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.truncate(path, whole)


def _read(path: Path, kind: str) -> list[dict[str, Any]]:
    records = []
    for number, line in enumerate(path.read_bytes().split(b"\n")[:-1], 1):
        try:
            record = json.loads(line)
            if record["kind"] != kind or not isinstance(record["seed"], int):
                raise ValueError
        except (ValueError, KeyError, TypeError):
            raise InvalidInput(
                f"{path}:{number}: is no run of this campaign: delete the line, the run will be repeated"
            ) from None
        records.append(record)
    return records
