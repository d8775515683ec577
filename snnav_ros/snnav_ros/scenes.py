"""A scene given to a node by its parameter `scene`: a file or the name of a shipped one."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from snnav_ros.parameters import ParameterReader
from snnav_sim.scene import AnyScene, Scene, SceneError, find_scene, load_any_scene

__all__ = ["read_planar_scene", "read_scene"]


def read_scene(reader: ParameterReader, *, required: bool = False) -> AnyScene | None:
    """Declare the parameter `scene` and return the scene it names, in the plane or in space, or None when it is empty.

    Parameters
    ----------
    reader : ParameterReader
    required : bool
        Whether the node cannot do without.

    Raises
    ------
    ParameterError
        With file, line, key and remedy if the scene cannot be used.
    """
    name: str = reader.value(
        "scene", str, "Scene file, or the name of a scene that comes with snnav_sim.", ""
    )
    if not name and required:
        reader.fail("scene", "is not given; give a scene file or a name (`snnav scenes` lists them)")
    if not name:
        return None
    try:
        path = find_scene(name)
        return _load(path, path.stat().st_mtime_ns)
    except SceneError as error:
        reader.fail("scene", str(error))


def read_planar_scene(reader: ParameterReader, *, required: bool = False) -> Scene | None:
    """The same for a node that serves the plane only.

    Raises
    ------
    ParameterError
        Also if the scene is one in space.
    """
    scene = read_scene(reader, required=required)
    if scene is None or isinstance(scene, Scene):
        return scene
    reader.fail("scene", f"{scene.name} is a scene in space; this node serves scenes in the plane")


@lru_cache(maxsize=4)
def _load(path: Path, _: int) -> AnyScene:
    """Read a scene once for all nodes of a process; the time of its last change keeps the memory honest."""
    return load_any_scene(path)
