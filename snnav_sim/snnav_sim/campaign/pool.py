"""Runs of a campaign in parallel processes, each result kept as soon as it is there."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from snnav_sim.campaign.ledger import Ledger
from snnav_sim.campaign.run import campaign_run, failed_run
from snnav_sim.warm_up import warm_up

__all__ = ["Progress", "finish"]

Progress = Callable[[dict[str, Any]], None]
"""Called with the record of every run that has ended."""

_PATIENCE = 5.0  # [s] until a process that was asked to end is killed


def finish(ledger: Ledger, jobs: int, progress: Progress | None = None) -> None:
    """Make the missing runs of a campaign.

    Parameters
    ----------
    ledger : Ledger
        Gets every run that ends; an interruption loses those that are going on.
    jobs : int
        Number of processes.
    progress : callable, optional

    Notes
    -----
    A process that dies takes the run that it was at with it: it is recorded as failed, and another one takes its place.
    """
    crew = _Crew(ledger.campaign.kind, ledger.directory, ledger.missing)
    try:
        for _ in range(min(jobs, len(crew.seeds))):
            crew.hire()
        while crew.workers:
            for record in crew.results():
                ledger.add(record)
                if progress is not None:
                    progress(record)
    finally:
        crew.dismiss()


@dataclass
class _Crew:
    """Processes, each with the seed of the run that it is at."""

    kind: str
    directory: Path
    seeds: list[int]
    workers: dict[Connection, tuple[BaseProcess, int]] = field(default_factory=dict)

    def hire(self) -> None:
        """Start a process and give it the next run."""
        context = multiprocessing.get_context("spawn")  # a fork would copy the threads of compiled code
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        self._give(ours, process)

    def _give(self, connection: Connection, process: BaseProcess) -> None:
        """Give a process the next run; without any it may go."""
        if self.seeds:
            seed = self.seeds.pop(0)
            self.workers[connection] = (process, seed)
            with suppress(OSError):  # one that has died is found by its silence
                connection.send((self.kind, seed, self.directory))
        else:
            self.workers.pop(connection, None)
            connection.close()

    def results(self) -> Sequence[dict[str, Any]]:
        """Wait until some runs have ended and return their records."""
        records = []
        for connection in wait(list(self.workers)):
            assert isinstance(connection, Connection)
            process, _ = self.workers[connection]
            try:
                records.append(connection.recv())
            except (EOFError, OSError):
                records.append(self._lost(connection))
                if self.seeds:
                    self.hire()
                continue
            self._give(connection, process)
        return records

    def _lost(self, connection: Connection) -> dict[str, Any]:
        """The record of a run whose process has died."""
        process, seed = self.workers.pop(connection)
        connection.close()
        process.join(_PATIENCE)
        error = f"the process of the run died with exit code {process.exitcode}"
        return failed_run(self.kind, seed, self.directory, error, error + "\n")

    def dismiss(self) -> None:
        """End all processes, at what they may be."""
        for process, _ in self.workers.values():
            process.terminate()
        for connection, (process, _) in self.workers.items():
            process.join(_PATIENCE)
            if process.is_alive():
                process.kill()
            connection.close()


def _work(connection: Connection) -> None:
    """What a process does: run after run, until nobody asks for more."""
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C reaches the whole group; the parent ends its processes
    warm_up()
    with suppress(EOFError, OSError):  # the parent is gone or needs no more
        while True:
            connection.send(campaign_run(*connection.recv()))
