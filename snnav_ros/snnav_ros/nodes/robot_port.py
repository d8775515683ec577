"""What a planner has to do with one robot: its topics and services."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from std_srvs.srv import SetBool, Trigger

from snnav_core.types import PlannedPath, Stop, StopReason
from snnav_ros.convert import path_to_message, seconds, stop_to_path, verdict_to_message
from snnav_ros.nodes.base import ManagedNode, status
from snnav_ros.qos import COMMAND, ODOMETRY_INPUT, for_mode

__all__ = ["RobotPort"]

_EXPECTED = (StopReason.ARRIVED, StopReason.NO_GOAL, StopReason.YIELDS, StopReason.NOT_TRACKED)


class RobotPort:
    """Publishes decisions for a robot and hears it.

    Parameters
    ----------
    node : ManagedNode
        The publishers last until it is cleaned up: what was said last must reach the robot.
    name : str
        Id of the robot.
    """

    def __init__(self, node: ManagedNode, name: str) -> None:
        self.enabled = True
        self._node, self._name = node, name
        command = for_mode(node.lockstep, COMMAND)
        self._paths = node.publisher(Path, f"{name}/path", command)
        self._verdicts = node.publisher(DiagnosticStatus, f"{name}/certificate", command)
        self._endings: list[Callable[[], object]] = []
        self._offers = False
        self._reason: StopReason | None = None

    def open(
        self,
        on_odometry: Callable[[Any], None],
        on_goal: Callable[[Any], None],
        enable: Callable[[bool], None],
        remove: Callable[[], str],
    ) -> None:
        """Hear odometry and goals, and offer `~/<robot>/enable` and `~/<robot>/remove`.

        `remove` returns why it could not be done, or an empty text.
        """
        self.close()
        self.enabled, self._reason = True, None
        node, name = self._node, self._name
        self._endings += [
            node.listen(Odometry, f"{name}/odom", on_odometry, for_mode(node.lockstep, ODOMETRY_INPUT)),
            node.listen(PoseStamped, f"{name}/goal_pose", on_goal, COMMAND),
        ]
        if node.options.lean or self._offers:
            return

        def on_enable(request: Any, response: Any) -> Any:
            enable(request.data)
            response.success, response.message = True, "on" if request.data else "off"
            return response

        def on_remove(_: Any, response: Any) -> Any:
            problem = remove()
            response.success, response.message = not problem, problem or f"robot {name} was taken out"
            return response

        # They stay when the robot leaves: one of them may be at work then.
        self._offers = True
        node.offer(SetBool, f"~/{name}/enable", on_enable)
        node.offer(Trigger, f"~/{name}/remove", on_remove)

    def close(self) -> None:
        """Hear nothing more of the robot."""
        while self._endings:
            self._endings.pop()()

    def publish(self, decision: PlannedPath | Stop, stamp: int) -> None:
        """Tell the robot what was decided for it at a time [ns]."""
        path = stop_to_path(stamp) if isinstance(decision, Stop) else path_to_message(decision.path)
        self._paths.publish(path)
        self._verdicts.publish(verdict_to_message(decision, stamp, path))

    def status(self, decision: PlannedPath | Stop, stamp: int, measured: int | None) -> DiagnosticStatus:
        """Return the diagnostic status of a decision of a time [ns]; a new reason to stop is logged once.

        `measured` is the stamp of the last odometry [ns].
        """
        self._tell(decision)
        name = self._name
        values: dict[str, object] = {
            "age": "none" if measured is None else f"{seconds(stamp - measured):.3f}"
        }
        if isinstance(decision, Stop):
            problem = "" if decision.reason is StopReason.ARRIVED else decision.message
            return status(f"robot {name}", name, problem, values | {"stop": decision.reason.value})
        values |= {"source": decision.source.value, "length": f"{decision.path.length:.3f}"}
        return status(f"robot {name}", name, "", values)

    def _tell(self, decision: PlannedPath | Stop) -> None:
        """Say once why a robot stops, and that it drives again."""
        reason = decision.reason if isinstance(decision, Stop) else None
        before, self._reason = self._reason, reason
        if reason is before:
            return
        log = self._node.get_logger()
        if not isinstance(decision, Stop):
            log.info(f"robot {self._name} drives again")
        elif reason in _EXPECTED:
            log.info(f"robot {self._name} stops ({decision.reason.value}): {decision.message}")
        else:
            log.warning(f"robot {self._name} stops ({decision.reason.value}): {decision.message}")

    def halt(self, stamp: int) -> None:
        """Stop a robot that another planner serves: a path without poses needs no certificate."""
        self._paths.publish(stop_to_path(stamp))
