"""Child processes of a bring-up: started with their parameter files, ended in every case."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import yaml

from snnav_ros.run import PARENT_VARIABLE

__all__ = ["ChildProcesses"]

_PATIENCE = 5.0  # [s] that a process has after SIGTERM; many end at the same time


class ChildProcesses:
    """The processes of a run.

    They are in a session of their own, so that a Ctrl-C reaches this process only, which then ends them; should this
    process be killed, they notice and end.

    Parameters
    ----------
    folder : Path
        For parameter files and what the processes print.
    domain : int
        Their ROS domain.
    """

    def __init__(self, folder: Path, domain: int) -> None:
        self._folder, self._domain = folder, domain
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._plans: dict[str, tuple[str, dict[str, Any]]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def start(self, name: str, module: str, parameters: Mapping[str, Any]) -> None:
        """Start one node.

        Parameters
        ----------
        name : str
            Name of the node.
        module : str
            Its executable as a module.
        parameters : mapping
        """
        self._plans[name] = module, dict(parameters)
        file = self._folder / f"{name}.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": dict(parameters)}}), encoding="utf-8")
        command = [
            sys.executable,
            "-m",
            module,
            "--ros-args",
            "-r",
            f"__node:={name}",
            "--params-file",
            str(file),
        ]
        environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(self._domain),
            PARENT_VARIABLE: str(os.getpid()),
        }
        with self._log(name).open("ab") as log:
            self._children[name] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )

    def kill(self, name: str, number: int = signal.SIGKILL) -> None:
        """Send a signal to the process of a node; after SIGKILL it is gone, and no longer expected to run."""
        child = self._children[name]
        _signal(child, number)
        if number == signal.SIGKILL:
            child.wait()
            del self._children[name]

    def restart(self, name: str, **changes: Any) -> None:
        """Start a node once more, with the parameters it had and these changes; one that still runs is killed."""
        if name in self._children:
            self.kill(name)
        module, parameters = self._plans[name]
        self.start(name, module, {**parameters, **changes})

    def ended(self) -> str:
        """Return which process has ended and what it said last, or an empty text."""
        for name, child in self._children.items():
            status = child.poll()
            if status is not None:
                lines = self._log(name).read_text(encoding="utf-8", errors="replace").strip().splitlines()
                return f"{name} ended with status {status}: {lines[-1] if lines else 'it said nothing'}"
        return ""

    def stop(self) -> None:
        """End all processes, by force if need be."""
        for child in self._children.values():
            _signal(child, signal.SIGTERM)
            _signal(child, signal.SIGCONT)  # one that was stopped could not hear it
        deadline = time.monotonic() + _PATIENCE
        for child in self._children.values():
            try:
                child.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                _signal(child, signal.SIGKILL)
                child.wait()
        self._children.clear()

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"


def _signal(child: subprocess.Popen[bytes], number: int) -> None:
    if child.poll() is None:
        child.send_signal(number)
