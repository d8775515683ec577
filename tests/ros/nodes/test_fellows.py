"""Several planners in real time: what one does that hears too little, too late, or something that is not right."""

from __future__ import annotations

from typing import Any

import pytest
import shapely
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.types import Certificate, PathSource, PlannedPath, Pose2D, Stop, StopReason, TimedPath
from snnav_ros.convert import (
    Word,
    area_to_message,
    odometry_to_message,
    path_to_message,
    stamp_message,
    stop_to_path,
    verdict_from_message,
    verdict_to_message,
    word_from_message,
    word_to_message,
)
from snnav_ros.nodes.planner import PlannerNode
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import INBOX, LATCHED

SECOND = 10**9
BODY = {"radius": 0.3, "speed": 0.5, "max_turn_rate": 1.0}
SITE = {
    "sampling_interval": 1.0,
    "safety_margin": 0.5,
    "boundary_speed": 0.0,
    "time_window": 4,
    "robots": ["own", "other"],
    **{f"{name}.{key}": value for name in ("own", "other") for key, value in BODY.items()},
    "use_sim_time": True,
    "serves": ["own"],
}
HALL = shapely.MultiPolygon([shapely.box(0.0, 0.0, 14.0, 8.0)])
PLACES = {"own": (2.0, 4.0), "other": (11.0, 2.0)}
GOAL = (12.0, 4.0)


class Site:
    """A planner of `own` beside another one, played by the test, that serves `other`."""

    def __init__(self, graph: Any, first: bool) -> None:
        """`first`: whether the planner under test decides before the other one."""
        self.graph, self.first, self.issue = graph, first, 0
        names = ["one", "another"] if first else ["another", "one"]
        self.node = graph.add(PlannerNode, "one", planners=names, **SITE)
        self.clock = graph.speak(Clock, "/clock", 1)
        self.area = graph.speak(PointCloud2, "unoccupied_area", LATCHED)
        self.mouth = graph.speak(DiagnosticStatus, "planners", LATCHED)
        self.odometry = {name: graph.speak(Odometry, f"{name}/odom") for name in PLACES}
        self.paths = graph.hear(Path, "own/path")
        self.stops = graph.hear(Path, "other/path")
        self.words = graph.hear(DiagnosticStatus, "planners", INBOX)
        self.path = graph.speak(Path, "other/path", 1)
        self.certificate = graph.speak(DiagnosticStatus, "other/certificate", 1)
        goal = PoseStamped()
        goal.header.frame_id = "map"
        goal.pose.position.x, goal.pose.position.y = GOAL
        graph.speak(PoseStamped, "own/goal_pose", 1).publish(goal)
        graph.until(lambda: "own" in self.node._goals)

    def at(self, stamp: float) -> None:
        stamp_ns = round(stamp * SECOND)
        self.clock.publish(Clock(clock=stamp_message(stamp_ns)))
        self.graph.until(lambda: self.node.get_clock().now().nanoseconds == stamp_ns, "the clock")

    def say(self, stamp: float, decided: bool = True, life: str = "a") -> None:
        self.issue += decided
        names = ("other",) if decided else ()
        self.mouth.publish(word_to_message(Word("another", round(stamp * SECOND), life, self.issue, names)))

    def stop_other(self, stamp: float) -> None:
        """Publish that the other robot stands."""
        stamp_ns = round(stamp * SECOND)
        path = stop_to_path(stamp_ns)
        self.path.publish(path)
        stop = Stop("other", StopReason.NO_GOAL, "robot other has no goal")
        self.certificate.publish(verdict_to_message(stop, stamp_ns, path))
        self.graph.until(lambda: self.node._fellows._heard.get("other", (-1,))[0] == stamp_ns, "the stop")

    def measure(self, stamp: float, speed: float = 0.0) -> None:
        """Tell where the robots are, and publish the area."""
        self.at(stamp)
        stamp_ns = round(stamp * SECOND)
        for name, (x, y) in PLACES.items():
            state = odometry_to_message(
                name, Pose2D(x, y, 0.0), speed if name == "other" else 0.0, 0.0, stamp_ns
            )
            self.odometry[name].publish(state)
            self.graph.until(lambda name=name: self.node._states.get(name, (-1,))[0] == stamp_ns, "odometry")
        self.area.publish(area_to_message(UnoccupiedArea(stamp, HALL)))
        self.graph.until(lambda: self.node._area_stamp == stamp_ns, "the area")

    def own_words(self) -> list[Word]:
        words = [word_from_message(message) for message in self.words]
        return [word for word in words if word.planner == "one"]

    def decides(self, stamp: float) -> bool:
        """Wait until it has said what it did at an instant, also by letting time go on; return whether it issued."""
        stamp_ns = round(stamp * SECOND)
        for later in (0.0, 0.2, 0.4, 0.6):
            if later:
                self.at(stamp + later)
            self.graph.work(0.1)
            words = [word for word in self.own_words() if word.stamp == stamp_ns]
            if words:
                return bool(words[-1].decided)
        raise AssertionError(f"nothing was said about {stamp} s")

    def cycle(self, stamp: float, *, heard: bool = True, speed: float = 0.0) -> bool:
        """One instant: the other planner decides before it or after it, if it is heard."""
        if heard and not self.first:
            self.at(stamp)
            self.stop_other(stamp)
            self.say(stamp)
        self.measure(stamp, speed)
        issued = self.decides(stamp)
        if heard and self.first:
            self.stop_other(stamp)
            self.say(stamp)
        return issued


def test_who_has_heard_all_decides_at_once(graph: Any) -> None:
    site = Site(graph, first=False)
    assert site.cycle(1.0), "the word tells of all robots: nothing of what was before counts"
    assert site.cycle(2.0)
    (word, *_) = site.own_words()
    assert (word.decided, word.stops, word.issue) == (("own",), (), 1)


def test_an_area_that_is_older_or_comes_twice_is_not_decided_for(graph: Any) -> None:
    """The others count on one word for each instant; a second one, or one gone back, would tell of other paths."""
    site = Site(graph, first=False)
    assert [site.cycle(stamp) for stamp in (1.0, 2.0)] == [True, True]
    for stamp in (2.0, 1.5):
        site.area.publish(area_to_message(UnoccupiedArea(stamp, HALL)))
        graph.work(0.2)
    site.at(2.9)
    graph.work(0.3)
    assert [word.stamp for word in site.own_words()] == [SECOND, 2 * SECOND]
    assert len(site.paths) == 2
    assert "is there another fusion node?" in site.node._problems["unoccupied_area"]
    assert site.cycle(3.0)


def test_a_promise_that_the_executor_still_holds_when_its_robot_leaves_is_dropped(graph: Any) -> None:
    site = Site(graph, first=False)
    (hears,) = (one for one in site.node.subscriptions if one.topic_name == "/other/path")
    hear = hears.callback
    site.node.robot_left("other")
    hear(stop_to_path(SECOND))
    assert "other" not in site.node._fellows._heard


def test_the_first_one_goes_by_the_last_words_of_those_after_it(graph: Any) -> None:
    site = Site(graph, first=True)
    assert not site.cycle(1.0), "nobody knows what was promised before"
    assert [site.cycle(stamp) for stamp in (2.0, 3.0)] == [True, True]


@pytest.mark.parametrize("first", [True, False])
def test_silence_ends_all_new_paths_until_one_window_has_passed(graph: Any, first: bool) -> None:
    site = Site(graph, first)
    for stamp in (1.0, 2.0, 3.0):
        site.cycle(stamp)
    missing = 5 if first else 4  # the first one has the word for 3 s when it decides for 4 s
    issued = {stamp: site.cycle(float(stamp), heard=False) for stamp in range(4, 11)}
    assert issued == {stamp: stamp < missing or stamp >= missing + 4 for stamp in issued}
    assert site.cycle(11.0), "the silent one is back, or its robots stand still"


def test_as_long_as_the_robots_of_the_silent_one_move_nothing_is_issued(graph: Any) -> None:
    site = Site(graph, first=False)
    assert site.cycle(1.0)
    assert not any(site.cycle(float(stamp), heard=False, speed=0.4) for stamp in range(2, 9))
    assert site.cycle(9.0, heard=False)


def test_a_word_without_its_path_is_not_enough(graph: Any) -> None:
    site = Site(graph, first=False)
    assert site.cycle(1.0)
    site.at(2.0)
    site.say(2.0)
    site.measure(2.0)
    assert not site.decides(2.0)


@pytest.mark.parametrize("altered", [False, True])
def test_only_a_sealed_path_counts(graph: Any, altered: bool, capfd: pytest.CaptureFixture[str]) -> None:
    site = Site(graph, first=False)
    assert site.cycle(1.0)
    site.at(2.0)
    path = TimedPath(2.0, 0.25, [[11.0 - 0.1 * k, 2.0] for k in range(20)])
    certificate = Certificate("other", True, 6.0, 1.0, 5.0, 9.0, 2.0, path.digest())
    message = path_to_message(path)
    verdict = verdict_to_message(
        PlannedPath("other", path, certificate, PathSource.TANGENT_GRAPH, 0.6), 2 * SECOND, message
    )
    if altered:
        verdict.values[-1].value = "0" * 64
    site.path.publish(message)
    site.certificate.publish(verdict)
    site.say(2.0)
    site.measure(2.0)
    assert site.decides(2.0) != altered
    assert ("promise for robot other not used" in capfd.readouterr().err) == altered


def test_a_restarted_planner_is_known_again_by_its_first_issue(graph: Any) -> None:
    site = Site(graph, first=False)
    assert site.cycle(1.0)
    site.at(2.0)
    site.issue = 0
    site.say(2.0, decided=False, life="b")
    site.measure(2.0)
    assert not site.decides(2.0)
    site.at(3.0)
    site.stop_other(3.0)
    site.say(3.0, life="b")
    site.measure(3.0)
    assert site.decides(3.0)


def test_a_planner_that_issued_nothing_is_no_riddle(graph: Any) -> None:
    site = Site(graph, first=False)
    assert site.cycle(1.0)
    site.at(2.0)
    site.say(2.0, decided=False)
    site.measure(2.0)
    assert site.decides(2.0)


@pytest.mark.parametrize("names", [["another"], ["one", "another", "another"]])
def test_a_list_of_planners_that_cannot_be_is_a_mistake(graph: Any, names: list[str]) -> None:
    with pytest.raises(ParameterError, match=r"planners: value .* does not name one and others, each once"):
        graph.add(PlannerNode, "one", planners=names, **SITE)


def test_what_is_published_is_a_stop_or_a_certified_path(graph: Any) -> None:
    site = Site(graph, first=False)
    verdicts = graph.hear(DiagnosticStatus, "own/certificate")
    assert site.cycle(1.0)
    graph.until(lambda: bool(verdicts))
    assert verdict_from_message(verdicts[-1]).certificate.accepted
    assert not any(path.poses for path in site.stops), "nothing but stops goes out for robots of others"
