"""A hall with boxes for flying robots: images of its cameras, the closed loop without ROS, what was kept."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from snnav_core.area.grid import Grid
from snnav_core.area.spatial_fusion import SpatialFusion, SpatialFusionSettings
from snnav_core.flight_types import FlyerState
from snnav_core.motion.flyer import step_flyer
from snnav_core.navigator.flight import FlightNavigator
from snnav_core.navigator.flight_settings import FlightSettings
from snnav_core.sensing.depth import DepthCamera, equal_angle, looking_at
from snnav_core.tracking.spatial import SpatialTracker, SpatialTrackerSettings
from snnav_core.types import FloatArray, RobotSpec, StepResult, Stop
from support.box_world import distance, image

ROOM = np.array([[0.0, 0.0, 0.0], [8.0, 7.0, 3.0]])
PERIOD = 0.05


def cameras(count: int = 4) -> list[DepthCamera]:
    places = np.array([[0.05, 0.05, 2.9], [7.95, 6.95, 2.9], [7.95, 0.05, 2.9], [0.05, 6.95, 2.9]])
    model = equal_angle(96, 96, range_max=12.0)
    middle = np.array([4.0, 3.5, 0.8])
    return [DepthCamera(f"cam_{k}", p, looking_at(p, middle), model) for k, p in enumerate(places)][:count]


@dataclass
class Hall:
    """The closed loop of some flying robots among boxes, which may move."""

    starts: dict[str, FloatArray]
    goals: dict[str, FloatArray]
    boxes: FloatArray = field(default_factory=lambda: np.empty((0, 2, 3)))
    velocity: FloatArray | None = None
    margin: float = 0.5
    boundary_speed: float = 0.0
    time_window: int = 6
    radius: float = 0.2
    silent_after: float = np.inf  # the cameras say nothing after this time [s]

    def __post_init__(self) -> None:
        self.eyes = cameras()
        grid = Grid.covering(ROOM[0], ROOM[1], 0.1)
        self.fusion = SpatialFusion(
            self.eyes, SpatialFusionSettings(grid, boundary_speed=self.boundary_speed)
        )
        robots = [RobotSpec(name, self.radius, 0.7, 2.0) for name in self.starts]
        settings = FlightSettings(0.2, self.margin, self.time_window, self.boundary_speed)
        self.navigator = FlightNavigator(robots, settings)
        ahead = np.array([1.0, 0.0, 0.0])
        self.states = {name: FlyerState(name, start, ahead, 0.0) for name, start in self.starts.items()}
        self.trackers = {
            robot.id: SpatialTracker(robot, SpatialTrackerSettings(), PERIOD) for robot in robots
        }
        self.least_clearance, self.least_separation = np.inf, np.inf
        self.step_number = 0
        self.results: list[StepResult] = []
        for start in self.starts.values():
            self.fusion.declare_free(start, self.margin + 0.2)

    def boxes_at(self, time: float) -> FloatArray:
        return self.boxes if self.velocity is None else self.boxes + self.velocity[:, None, :] * time

    def decide(self) -> StepResult:
        """Look, fuse, plan and hand out the paths."""
        time = 0.2 * self.step_number
        self.step_number += 1
        if time <= self.silent_after:
            spheres = np.array([[*state.position, self.radius] for state in self.states.values()])
            for eye in self.eyes:
                self.fusion.add_image(eye.id, image(eye, self.boxes_at(time), ROOM, time), spheres)
        states = {name: replace(state, stamp=time) for name, state in self.states.items()}
        result = self.navigator.step(time, self.fusion.area(time), states, self.goals)
        for name, decision in result.decisions.items():
            state = self.states[name]
            if isinstance(decision, Stop):
                self.trackers[name].set_path(None)
            else:
                direction = state.direction if state.speed > 0.0 else None
                until = decision.certificate.valid_until
                self.trackers[name].set_path(decision.path, direction, until)
        self.results.append(result)
        return result

    def fly(self, seconds: float) -> None:
        """Fly on as commanded, and measure the truth every control period."""
        begin = 0.2 * (self.step_number - 1)
        for tick in range(round(seconds / PERIOD)):
            time = begin + PERIOD * tick
            for name, state in self.states.items():
                command = self.trackers[name].command(state, time)
                self.states[name] = step_flyer(state, command, 2.0, PERIOD)
            self._measure(time + PERIOD)

    def _measure(self, time: float) -> None:
        places = np.array([state.position for state in self.states.values()])
        to_walls = np.minimum(places - ROOM[0], ROOM[1] - places).min()
        boxes = self.boxes_at(time)
        to_boxes = distance(places, boxes).min() if len(boxes) else np.inf
        self.least_clearance = min(self.least_clearance, float(to_walls), float(to_boxes))
        apart = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(len(places), 1)]
        self.least_separation = min(self.least_separation, float(apart.min(initial=np.inf)) - self.radius)

    def reasons(self) -> dict[str, str]:
        """How the last decision left every robot."""
        last = self.results[-1].decisions
        return {name: one.reason.value if isinstance(one, Stop) else "flies" for name, one in last.items()}

    def run(self, limit: float) -> None:
        """Decide and fly until all have arrived, or the time [s] is up."""
        while 0.2 * self.step_number < limit:
            self.decide()
            if set(self.reasons().values()) == {"arrived"}:
                return
            self.fly(0.2)
