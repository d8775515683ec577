"""The node of one range finder of a scene: simulated, or repeating a recorded scan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import LaserScan

from snnav_core.sensing.scan import PlanarScan
from snnav_ros.convert import nanoseconds, scan_to_message, seconds
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import NodeOptions, now_of, serve
from snnav_ros.parameters import ParameterReader
from snnav_ros.qos import SENSOR, for_mode
from snnav_ros.scenes import read_scene
from snnav_ros.waiting import WaitingReport
from snnav_sim.devices import make_device
from snnav_sim.world import World

__all__ = ["Lms200Node", "ScannerParameters"]

_REAL_TIME_PERIOD = 0.2  # [s]


@dataclass(frozen=True)
class ScannerParameters:
    """Parameters of the node besides `scene`.

    Parameters
    ----------
    sensor_id : str
        Which sensor of the scene this is; may stay empty when there is only one.
    seed : int or None
        Of noise and drop-outs; the scene's when left out.
    scan_period : float or None
        Time from scan to scan in real time [s]; 0.2 s or the sampling interval, whichever is shorter, when left out.
    lockstep : bool
        Simulated time goes on only when all nodes have consumed the data of a tick.
    """

    sensor_id: str = ""
    seed: int | None = None
    scan_period: float | None = None
    lockstep: bool = False


class Lms200Node(Node):
    """Publishes `sensors/<id>/scan`.

    With `use_sim_time` the time of the scene is the time of ROS; else the scene begins when the node starts.
    """

    def __init__(self, options: NodeOptions | None = None) -> None:
        options = options or NodeOptions()
        super().__init__(options.name or "lms200_node", **options.keywords())
        reader = ParameterReader(self)
        scene = read_scene(reader, required=True)
        assert scene is not None
        self.settings = reader.settings(ScannerParameters)
        reader.finish()
        ids = [sensor.id for sensor in scene.sensors]
        chosen = self.settings.sensor_id or (ids[0] if len(ids) == 1 else "")
        if chosen not in ids:
            reader.fail(
                "sensor_id", f"value {chosen!r} names no sensor of {scene.name}; it has {', '.join(ids)}"
            )
        sensor = scene.sensors[ids.index(chosen)]
        seed = scene.seed if self.settings.seed is None else self.settings.seed
        self._device = make_device(sensor, World(scene), seed)
        self._enabled = True
        lockstep = self.settings.lockstep
        self._scans = self.create_publisher(LaserScan, f"sensors/{chosen}/scan", for_mode(lockstep, SENSOR))
        serve(self, options, lambda: None, {"enable": self._enable})
        if lockstep:
            self._participant = Participant(
                self, nanoseconds(scene.sampling_interval), self._on_tick, lambda: None
            )
        else:
            simulated = self.get_parameter("use_sim_time").value
            self._origin = 0 if simulated else now_of(self)
            period = self.settings.scan_period or min(_REAL_TIME_PERIOD, scene.sampling_interval)
            self.create_timer(period, self._on_timer)
        self._waiting = WaitingReport(self, self._inputs)

    def _inputs(self) -> list[str]:
        simulated = self.get_parameter("use_sim_time").value
        return ["/clock"] if self.settings.lockstep or simulated else []

    def _enable(self, enabled: bool) -> None:
        self._enabled = enabled

    def _on_tick(self, tick: int) -> None:
        self._waiting.heard("/clock")
        scan = self._device.scan(seconds(tick))
        # The fusion waits for a scan in lockstep: a device that is switched off sends one that saw nothing.
        self._publish(scan if self._enabled else _blind(scan), tick)
        self._participant.done()

    def _on_timer(self) -> None:
        self._waiting.heard("/clock")
        now = now_of(self)
        if self._enabled:
            self._publish(self._device.scan(seconds(now - self._origin)), now)

    def _publish(self, scan: PlanarScan, stamp_ns: int) -> None:
        self._scans.publish(scan_to_message(scan, self._device.sensor.id, stamp_ns))


def _blind(scan: PlanarScan) -> PlanarScan:
    return replace(scan, ranges=np.full(scan.ranges.shape, np.nan))
