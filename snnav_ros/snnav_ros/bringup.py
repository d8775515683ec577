"""Run a whole scene through the nodes: in one process, or as separate processes."""

from __future__ import annotations

import importlib
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from snnav_core.errors import SnnavError
from snnav_ros.available import make_executor, require_ros
from snnav_ros.bag.writer import BagWriter
from snnav_ros.casting import (
    CLOCK,
    FUSION,
    TRACKER,
    device_of,
    every_sample,
    every_tick,
    is_unplanned,
    share_robots,
)
from snnav_ros.domain import free_domain
from snnav_ros.processes import ChildProcesses
from snnav_ros.recorder import RunCollector, RunProgress, record_of
from snnav_ros.signals import noted_signals
from snnav_sim.report.record import RunRecord
from snnav_sim.scene import AnyScene, SpaceScene, dump_scene
from snnav_sim.warm_up import warm_up

__all__ = ["BringupError", "NodePlan", "plan_nodes", "run_scene"]

_WAIT = 0.2  # [s] from one look at signals and child processes to the next
_STALL = 60.0  # [s] without any message


class BringupError(SnnavError):
    """A run of nodes could not go on."""


@dataclass(frozen=True)
class NodePlan:
    """One node of a scene.

    Parameters
    ----------
    name : str
        Name of the node.
    module : str
        Of snnav_ros.nodes, without the ending of its executable: ``fusion`` stands for ``fusion_node``.
    class_name : str
    parameters : mapping
    """

    name: str
    module: str
    class_name: str
    parameters: Mapping[str, Any]


def plan_nodes(
    scene: AnyScene, scene_file: Path, *, realtime: bool, processes: bool, seed: int, planners: int = 1
) -> list[NodePlan]:
    """Return the nodes that a scene needs, the clock last."""
    # In lockstep a node goes by ticks; its own clock of ROS would hear every one of them once more.
    common = {"scene": str(scene_file), "lockstep": not realtime, "use_sim_time": realtime or processes}
    plans: list[NodePlan] = []
    shares = share_robots(scene, planners)
    several = {"planners": list(shares)} if len(shares) > 1 else {}
    if not is_unplanned(scene):
        device = device_of(scene)
        plans += [
            NodePlan(
                sensor.id, device, f"{device.title()}Node", {**common, "sensor_id": sensor.id, "seed": seed}
            )
            for sensor in scene.sensors
        ]
        plans.append(NodePlan(FUSION, "fusion", "FusionNode", common))
        plans += _deciding(scene, common, shares, several, seed)
    plans += [
        NodePlan(robot.id, "robot", "RobotNode", {**common, **several, "robot_id": robot.id})
        for robot in scene.robots
    ]
    clock: dict[str, Any] = {**common, "use_sim_time": False}
    if not realtime:
        from snnav_ros.nodes.recorder import RECORDER

        clock["every_tick"] = [*every_tick(scene), RECORDER]
        clock["every_sample"] = list(every_sample(scene, list(shares)))
    return [*plans, NodePlan(CLOCK, "clock", "ClockNode", clock)]


def _deciding(
    scene: AnyScene,
    common: Mapping[str, Any],
    shares: Mapping[str, list[str]],
    several: Mapping[str, Any],
    seed: int,
) -> list[NodePlan]:
    """Return the nodes that decide, and the body tracker that the global planner needs."""
    if scene.plans_globally:
        planner = NodePlan(next(iter(shares)), "global_planner", "GlobalPlannerNode", common)
        return [NodePlan(TRACKER, "tracker", "TrackerNode", common), planner]
    samples = {"flight.seed": seed} if isinstance(scene, SpaceScene) else {}
    return [
        NodePlan(
            name,
            "planner",
            "PlannerNode",
            {**common, **samples, **several, **({"serves": robots} if several else {})},
        )
        for name, robots in shares.items()
    ]


def run_scene(
    scene: AnyScene,
    *,
    processes: bool = False,
    realtime: bool = False,
    seed: int | None = None,
    bag: Path | None = None,
    progress: RunProgress | None = None,
    planners: int = 1,
) -> RunRecord:
    """Run a scene through the nodes until all robots arrived, the time limit, or nothing will change any more.

    Parameters
    ----------
    scene : Scene or SpaceScene
    processes : bool
        Every node as a process of its own instead of all in this one.
    realtime : bool
        Simulated time goes like time on the wall instead of in lockstep.
    seed : int, optional
        Instead of the seed of the scene.
    bag : Path, optional
        Rosbag2 directory to record all topics into; it appears when the run is complete.
    progress : callable, optional
        Called once per sampling interval with the simulated time and the record up to then.
    planners : int
        So many planner nodes share the robots.

    Returns
    -------
    RunRecord

    Raises
    ------
    InvalidInput
        If there are fewer robots than planners, or several planners for a scene in space or with the global planner.
    MissingRos
        If there is no rclpy.
    BringupError
        If a process of a node ended before the run did, or nothing is published for a minute.
    KeyboardInterrupt
        After SIGINT or SIGTERM, once the present callback is through.
    """
    require_ros("running a scene through the nodes")
    if realtime:
        warm_up()  # in lockstep the compiler holds up nothing
    record = record_of(scene, scene.seed if seed is None else seed)
    record.versions |= {"rclpy": version("rclpy"), "rmw": _middleware()}
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with ExitStack() as stack:
        told = stack.enter_context(noted_signals())
        domain = stack.enter_context(free_domain())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="snnav-")))
        scene_file = folder / "scene.yaml"
        scene_file.write_text(dump_scene(scene), encoding="utf-8")
        writer = None if bag is None else stack.enter_context(BagWriter(bag))
        several = list(share_robots(scene, planners)) if planners > 1 else []
        collector = RunCollector(scene, record, writer, not realtime, progress, several)
        plans = plan_nodes(
            scene, scene_file, realtime=realtime, processes=processes, seed=record.seed, planners=planners
        )
        children = None
        if processes:
            children = stack.enter_context(ChildProcesses(folder, domain))
            for plan in plans:
                children.start(plan.name, f"snnav_ros.nodes.{plan.module}_node", plan.parameters)
            plans = []
        context = stack.enter_context(_ros(domain))
        executor = stack.enter_context(_executor(context))
        recorder = _add_nodes(
            stack, executor, context, scene, plans, collector, lockstep=not realtime, several=bool(several)
        )
        _spin(executor, recorder, collector, children, told)
        collector.close()
    return record


def _middleware() -> str:
    from rclpy.utilities import get_rmw_implementation_identifier

    return str(get_rmw_implementation_identifier())


@contextmanager
def _ros(domain: int) -> Iterator[Any]:
    """Provide a context of ROS of its own; signals stay with Python."""
    import rclpy

    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=domain)
    try:
        yield context
    finally:
        rclpy.try_shutdown(context=context)


@contextmanager
def _executor(context: Any) -> Iterator[Any]:
    executor = make_executor(context)
    try:
        yield executor
    finally:
        executor.shutdown()


def _add_nodes(
    stack: ExitStack,
    executor: Any,
    context: Any,
    scene: AnyScene,
    plans: list[NodePlan],
    collector: RunCollector,
    *,
    lockstep: bool,
    several: bool,
) -> Any:
    """Make the planned nodes and the recorder, and return this; they are destroyed when the stack unwinds."""
    from rclpy.logging import LoggingSeverity, set_logger_level

    from snnav_ros.nodes.base import NodeOptions
    from snnav_ros.nodes.recorder import RecorderNode

    def add(node: Any) -> None:
        stack.callback(node.destroy_node)
        executor.add_node(node)

    recorder = RecorderNode(NodeOptions(context=context, lean=True), scene, collector, lockstep, several)
    add(recorder)
    for plan in plans:
        set_logger_level(plan.name, LoggingSeverity.WARN)
        stack.callback(set_logger_level, plan.name, LoggingSeverity.UNSET)
        node_class = getattr(importlib.import_module(f"snnav_ros.nodes.{plan.module}"), plan.class_name)
        add(node_class(NodeOptions(plan.name, plan.parameters, context, lean=True)))
    return recorder


def _spin(
    executor: Any,
    recorder: Any,
    collector: RunCollector,
    children: ChildProcesses | None,
    told: Callable[[], bool],
) -> None:
    look = alive = time.monotonic()
    messages = -1
    while not collector.finished:
        executor.spin_once(timeout_sec=_WAIT)
        if told():
            raise KeyboardInterrupt
        now = time.monotonic()
        if now - look < _WAIT:
            continue
        look = now
        if children is not None and (ended := children.ended()):
            raise BringupError(ended)
        if collector.messages != messages:
            messages, alive = collector.messages, now
        elif now - alive > _STALL:
            raise BringupError(
                f"nothing was published for {_STALL:g} s; the recorder waits for {recorder.missing()}"
            )
