"""colcon builds the workspace, and its executables land where `ros2 run` looks."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("snnav_core", "snnav_sim", "snnav_ros")
NODES = ("lms200_node", "fusion_node", "planner_node", "robot_node", "clock_node")


def run(*command: str | Path, cwd: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a program to its end; show what it said when it failed."""
    environment = os.environ | variables
    result = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the three packages with colcon, away from the sources."""
    folder = tmp_path_factory.mktemp("workspace")
    bases = ["--build-base", folder / "build", "--install-base", folder / "install"]
    colcon = [sys.executable, "-m", "colcon", "--log-base", folder / "log", "build", *bases]
    run(*colcon, "--base-paths", *(ROOT / name for name in PACKAGES), cwd=folder)
    return folder / "install"


@pytest.mark.slow
def test_executables_and_shared_files_are_installed(installed: Path) -> None:
    for name in PACKAGES:
        share = installed / name / "share"
        assert (share / name / "package.xml").is_file()
        assert (share / "ament_index" / "resource_index" / "packages" / name).is_file()
    for name in (*NODES, "snnav"):
        assert os.access(installed / "snnav_ros" / "lib" / "snnav_ros" / name, os.X_OK)
    for folder in ("launch", "config", "rviz"):
        sources = {path.name for path in (ROOT / "snnav_ros" / folder).glob("*.*")}
        assert sources == {
            path.name for path in (installed / "snnav_ros" / "share" / "snnav_ros" / folder).glob("*.*")
        }


@pytest.mark.slow
def test_installed_command_finds_the_installed_scenes(installed: Path) -> None:
    sites = [next((installed / name / "lib").glob("python3.*/site-packages")) for name in PACKAGES]
    path = os.pathsep.join([*map(str, sites), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    program = installed / "snnav_ros" / "lib" / "snnav_ros" / "snnav"
    told = run(program, "scenes", cwd=installed, PYTHONPATH=path).stdout
    shipped = {scene.stem for scene in (ROOT / "snnav_sim" / "snnav_sim" / "scenes").glob("*.yaml")}
    assert shipped
    assert all(name in told for name in shipped)
    where = run(
        sys.executable, "-c", "import snnav_sim; print(snnav_sim.__file__)", cwd=installed, PYTHONPATH=path
    )
    assert where.stdout.startswith(str(installed))


@pytest.mark.parametrize("name", PACKAGES)
def test_colcon_test_selects_tests(name: str) -> None:
    arguments = json.loads((ROOT / "colcon.meta").read_text(encoding="utf-8"))["names"][name]["pytest-args"]
    told = run(sys.executable, "-m", "pytest", "--collect-only", "-q", *arguments, cwd=ROOT / name, CI="true")
    assert f"tests/{name.removeprefix('snnav_')}/test_package.py::" in told.stdout
