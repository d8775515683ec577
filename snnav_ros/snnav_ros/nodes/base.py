"""What all nodes share: how they are made, states, services, diagnostics."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.context import Context
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool, Trigger

from snnav_ros.convert.frames import header
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.node_time import is_simulated, steady_clock
from snnav_ros.parameters import ParameterReader
from snnav_ros.waiting import WaitingReport

__all__ = [
    "LOCKSTEP_TEXT",
    "ManagedNode",
    "NodeOptions",
    "diagnostics",
    "serve",
    "status",
]

LOCKSTEP_TEXT = "Simulated time goes on only when all nodes have consumed the data of a tick."


@dataclass(frozen=True)
class NodeOptions:
    """How a node is made; an executable takes the defaults.

    Parameters
    ----------
    name : str or None
        Instead of the usual name of the node.
    parameters : mapping
        Overrides of parameters.
    context : Context or None
        Of ROS; None for the default one.
    lean : bool
        Leave out what only a person or another program would use: services for parameters, lifecycle, reset and
        pause, and the log topic. For many nodes in one process.
    """

    name: str | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    context: Context | None = None
    lean: bool = False

    def keywords(self) -> dict[str, Any]:
        """Return the keyword arguments of rclpy's Node."""
        return {
            "context": self.context,
            "start_parameter_services": not self.lean,
            "enable_rosout": not self.lean,
            "automatically_declare_parameters_from_overrides": True,
            "parameter_overrides": [Parameter(name, value=value) for name, value in self.parameters.items()],
        }


class ManagedNode(LifecycleNode, ABC):
    """A lifecycle node that goes active by itself unless the parameter `autostart` says no.

    A subclass makes publishers in `configure`, listens and starts timers in `start`. What it made with the methods of
    this class goes away when the node is deactivated or cleaned up.
    """

    def __init__(self, default_name: str, options: NodeOptions) -> None:
        super().__init__(
            options.name or default_name,
            enable_communication_interface=not options.lean,
            **options.keywords(),
        )
        self.options = options
        self.reader = ParameterReader(self)
        self.lockstep: bool = self.reader.value("lockstep", bool, LOCKSTEP_TEXT, False)
        self._autostart: bool = self.reader.value(
            "autostart", bool, "Configure and activate the node at its start.", True
        )
        self._release: list[Callable[[], object]] = []
        self._halt: list[Callable[[], object]] = []
        self._round = 0  # counts activations and deactivations

    def autostart(self) -> None:
        """Go active if the parameter says so; a subclass calls it at the end of its constructor."""
        if self._autostart:
            self.trigger_configure()
            self.trigger_activate()
        else:
            self.get_logger().info("waiting for: the transitions configure and activate (autostart is false)")

    @abstractmethod
    def configure(self) -> None:
        """Make publishers."""

    @abstractmethod
    def start(self) -> None:
        """Listen and start timers."""

    def publisher(self, kind: Any, topic: str, qos: QoSProfile) -> Any:
        """Return a publisher that lasts until the node is cleaned up."""
        publisher = self.create_publisher(kind, topic, qos)
        self._release.append(lambda: self.destroy_publisher(publisher))
        return publisher

    def offer(self, kind: Any, name: str, callback: Callable[[Any, Any], Any]) -> None:
        """Offer a service until the node is cleaned up."""
        service = self.create_service(kind, name, callback)
        self._release.append(lambda: self.destroy_service(service))

    def listen(
        self, kind: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile
    ) -> Callable[[], object]:
        """Hear a topic until the node is deactivated; return what ends it before, also for what the executor holds."""
        hear, ended = self._while_active(callback), False

        def call(message: Any) -> None:
            if not ended:
                hear(message)

        subscription = self.create_subscription(kind, topic, call, qos)

        def end() -> None:
            nonlocal ended
            ended = True
            if end in self._halt:
                self._halt.remove(end)
            self.destroy_subscription(subscription)

        self._halt.append(end)
        return end

    def every(self, period: float, callback: Callable[[], None]) -> None:
        """Call something periodically [s] until the node is deactivated.

        The period is one of simulated time, or of a steady clock: a timer on the clock of the machine would stand
        still for an hour when that is set back by one.
        """
        clock = None if is_simulated(self) else steady_clock()
        timer = self.create_timer(period, self._while_active(callback), clock=clock)
        self._halt.append(lambda: self.destroy_timer(timer))

    def participate(
        self, period_ns: int, on_tick: Callable[[int], None], on_reset: Callable[[], None]
    ) -> Participant:
        """Take part in lockstep until the node is deactivated."""
        participant = Participant(self, period_ns, self._while_active(on_tick), on_reset)
        self._halt.append(participant.destroy)
        return participant

    def _while_active(self, callback: Callable[..., None]) -> Callable[..., None]:
        """Return the callback, deaf to what the executor still holds when the node is deactivated."""
        round_ = self._round

        def call(*arguments: Any) -> None:
            if self._round == round_:
                callback(*arguments)

        return call

    def report_waiting(self, expected: Callable[[], Sequence[str]]) -> WaitingReport:
        """Say what is waited for until the node is deactivated."""
        report = WaitingReport(self, expected)
        self._halt.append(report.destroy)
        return report

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition unconfigured -> inactive."""
        self.configure()
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition inactive -> active."""
        self._round += 1
        self.start()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition active -> inactive."""
        self._end_round()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition inactive -> unconfigured."""
        _call_all(self._release)
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to finalized."""
        self._end_round()
        _call_all(self._release)
        return super().on_shutdown(state)

    def _end_round(self) -> None:
        self._round += 1
        _call_all(self._halt)


def _call_all(callbacks: list[Callable[[], object]]) -> None:
    while callbacks:
        callbacks.pop()()


def serve(
    node: Node,
    options: NodeOptions,
    reset: Callable[[], None],
    switches: Mapping[str, Callable[[bool], None]],
) -> None:
    """Offer `~/reset`, and a SetBool service `~/<name>` for every switch, unless the node is lean."""
    if options.lean:
        return

    def on_reset(_: Any, response: Any) -> Any:
        reset()
        response.success, response.message = True, "started afresh"
        return response

    def handler(switch: Callable[[bool], None]) -> Callable[[Any, Any], Any]:
        def on_switch(request: Any, response: Any) -> Any:
            switch(request.data)
            response.success, response.message = True, "on" if request.data else "off"
            return response

        return on_switch

    node.create_service(Trigger, "~/reset", on_reset)
    for name, switch in switches.items():
        node.create_service(SetBool, f"~/{name}", handler(switch))


def diagnostics(stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> DiagnosticArray:
    """Return the message for `/diagnostics`."""
    return DiagnosticArray(header=header(stamp_ns, ""), status=list(statuses))


def status(name: str, hardware: str, problem: str, values: Mapping[str, object]) -> DiagnosticStatus:
    """Return one diagnostic status: OK without a problem, WARN with one."""
    level = DiagnosticStatus.WARN if problem else DiagnosticStatus.OK
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(
        level=level, name=name, hardware_id=hardware, message=problem or "ok", values=pairs
    )
