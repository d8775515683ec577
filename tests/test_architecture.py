"""The arrows of docs/architecture.md point one way, and the house rules that a machine can check hold."""

from __future__ import annotations

import ast
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# Floors from below; a module may import from its own floor and from those below it.
CORE_FLOORS: tuple[tuple[str, ...], ...] = (
    ("errors", "types", "checks", "obstacles", "flight_types"),
    ("sensing", "motion"),
    ("area", "mapping", "search", "tracking"),
    ("planning",),
    ("navigator",),
)
CORE = len(CORE_FLOORS)
SIMULATION, NODES, COMMAND_LINE = CORE, CORE + 1, CORE + 2

# What each package may import besides the standard library and the packages below it.
THIRD_PARTY = {
    "snnav_core": {"numpy", "scipy", "shapely", "numba"},
    "snnav_sim": {
        "numpy",
        "scipy",
        "shapely",
        "numba",
        "yaml",
        "matplotlib",
        "mpl_toolkits",
        "PIL",
        "rich",
        "trimesh",
        "embreex",
    },
}

ROSDEP_KEYS = {"tf2_ros": "tf2_ros_py", "PIL": "pil", "mpl_toolkits": "matplotlib", "trimesh": "trimesh-pip"}
WITHOUT_ROSDEP_KEY = {
    "embreex",
    "rosbags",
    "rosidl_parser",
}  # from requirements.txt, and what rclpy brings along

LONGEST_MODULE = 400
LONGEST_FUNCTION = 60


def modules() -> dict[str, Path]:
    """Return every module of the three packages by its dotted name."""
    found = {}
    for package in ("snnav_core", "snnav_sim", "snnav_ros"):
        for path in sorted((ROOT / package / package).rglob("*.py")):
            parts = path.relative_to(ROOT / package).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()
TESTS = {str(path.relative_to(ROOT)): path for path in sorted((ROOT / "tests").rglob("*.py"))}


def imported(name: str) -> set[str]:
    """Return the dotted names that a module imports, anywhere in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(MODULES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative import in line {node.lineno}"
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            names.update({one if one in MODULES else str(node.module) for one in inner})
    return names


def floor(name: str) -> int:
    """Return the floor that a module of snnav stands on."""
    package, _, rest = name.partition(".")
    if package == "snnav_core":
        part = rest.partition(".")[0]
        if not part:
            return 0  # the package text itself may import nothing of snnav
        return next((level for level, parts in enumerate(CORE_FLOORS) if part in parts), -1)
    if package == "snnav_sim":
        return SIMULATION
    return COMMAND_LINE if rest == "cli" or rest.startswith("cli.") else NODES


def test_there_are_modules_to_check() -> None:
    assert {"snnav_core.types", "snnav_core.errors"} <= MODULES.keys()
    assert "tests/test_architecture.py" in TESTS


def test_every_module_of_the_core_stands_on_a_floor() -> None:
    homeless = [name for name in MODULES if floor(name) < 0]
    assert not homeless, f"give these a floor in CORE_FLOORS: {homeless}"


@pytest.mark.parametrize("name", MODULES)
def test_no_import_goes_up(name: str) -> None:
    upward = [other for other in imported(name) if other.startswith("snnav_") and floor(other) > floor(name)]
    assert not upward, f"{name} imports from a floor above it: {sorted(upward)}"


@pytest.mark.parametrize("name", [name for name in MODULES if name.split(".")[0] in THIRD_PARTY])
def test_imports_only_what_its_package_may_use(name: str) -> None:
    package = name.partition(".")[0]
    allowed = THIRD_PARTY[package] | sys.stdlib_module_names | {"snnav_core", package}
    foreign = {other.partition(".")[0] for other in imported(name)} - allowed
    assert not foreign, f"{name} imports {sorted(foreign)}"


@pytest.mark.parametrize("package", ["snnav_core", "snnav_sim", "snnav_ros"])
def test_the_manifest_declares_what_is_imported(package: str) -> None:
    manifest = ElementTree.parse(ROOT / package / "package.xml").getroot()
    declared = {str(element.text).removeprefix("python3-") for element in manifest.iter("exec_depend")}
    names = {
        other.partition(".")[0]
        for name in MODULES
        if name.split(".")[0] == package
        for other in imported(name)
    }
    keys = {ROSDEP_KEYS.get(name, name) for name in names - sys.stdlib_module_names - {package}}
    assert keys - WITHOUT_ROSDEP_KEY <= declared


def test_drawing_stays_in_the_report() -> None:
    drawing = {name for name in MODULES if any(other.startswith("matplotlib") for other in imported(name))}
    assert all(name.startswith("snnav_sim.report") for name in drawing), sorted(drawing)


@pytest.mark.parametrize("name", [*MODULES, *TESTS])
def test_modules_and_functions_stay_short(name: str) -> None:
    source = (MODULES | TESTS)[name].read_text(encoding="utf-8")
    lines = source.count("\n")
    assert lines <= LONGEST_MODULE, f"{name} has {lines} lines: one concept per module"
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node, clean=False)
            length = (node.end_lineno or 0) - node.lineno + 1 - (text.count("\n") + 1 if text else 0)
            assert length <= LONGEST_FUNCTION, f"{name}.{node.name} has {length} lines: one job per function"


def loaded_by(names: list[str]) -> set[str]:
    """Import modules in a fresh interpreter outside the repository; return the top-level names then loaded."""
    code = (
        "import importlib, sys\nfor name in sys.argv[1:]: importlib.import_module(name)\nprint(*sys.modules)"
    )
    command = [sys.executable, "-c", code, *names]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd="/", timeout=120)
    assert result.returncode == 0, result.stderr
    return {name.partition(".")[0] for name in result.stdout.split()}


def test_importing_the_whole_core_loads_neither_ros_nor_a_drawing_library() -> None:
    names = [name for name in MODULES if name.startswith("snnav_core")]
    tops = loaded_by(names)
    assert "snnav_core" in tops
    assert not tops & {"rclpy", "matplotlib", "snnav_sim", "snnav_ros", "rosbags"}


def test_importing_the_whole_simulation_loads_no_ros() -> None:
    names = [name for name in MODULES if name.startswith("snnav_sim")]
    tops = loaded_by(names)
    assert "snnav_sim" in tops
    assert not tops & {"rclpy", "rosbags", "snnav_ros"}
