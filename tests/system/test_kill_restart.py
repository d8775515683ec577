"""Real processes over DDS: any node is killed, put to sleep or started afresh in mid-run, and the robot stays safe.

The robot's base is in the hands of this test: it does what `cart/cmd_vel` says, for at most 0.1 s after the stamp of
the last command. So what the robot node promises is judged by code that it does not share.

All is recorded, and judged by what the recording says. Messages are recorded with the time of their receipt on this
machine, a clock that nobody sets: simulated time stands still while `clock_node` is dead and begins anew with it, so
it cannot tell what came first. What was promised is compared in simulated time, that of headers and certificates
(`snnav_ros.bag.drives`). The moments of kills and restarts are in the bag on `events`. Beside the bag there is a
picture of every stop and recovery.
"""

from __future__ import annotations

import math
import signal
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np
import pytest
import shapely
from std_srvs.srv import Trigger

from snnav_ros.bag.drives import Drive, Event, read_drive
from snnav_ros.bag.reader import BagReader
from snnav_ros.bag.run_windows import window_curves
from snnav_sim.report.window_figure import draw_window
from snnav_sim.scene import Scene
from support.corridor_site import INTERVAL, RESET, RESTART, STILL, Listener, Site, site

KINDS = {
    "lms200": "west",
    "fusion": "fusion_node",
    "planner": "planner_node",
    "robot": "cart",
    "clock": "clock_node",
}
NAP = 3.0 * INTERVAL


def kill_and_restart(site: Site, kind: str) -> None:
    """Kill the node of a kind while the robot drives, see it stop, start the node again and see it drive."""
    name = KINDS[kind]
    site.until_it_drives()
    said = len(site.texts)
    site.signal(name, signal.SIGKILL)
    if kind == "lms200":  # until what it saw is gone the robot may go to and fro
        reason = "sensor west is silent since"
        site.until(lambda: any(reason in text for text in site.texts[said:]), "the reason of a stop")
    site.until_it_stands(kind)
    site.restart(name)
    site.until_it_drives()


def nap(site: Site, kind: str) -> None:
    """Stop the process of a node for three sampling intervals while the robot drives, and see it drive again."""
    site.until_it_drives()
    site.signal(KINDS[kind], signal.SIGSTOP)
    site.wait(kind, NAP)
    site.signal(KINDS[kind], signal.SIGCONT)
    site.until_it_drives()


def set_back_the_clock(site: Site) -> None:
    """Let the clock begin anew while the robot drives."""
    site.until_it_drives()
    client = site.node.create_client(Trigger, "clock_node/reset")
    site.until(client.service_is_ready, "the service")
    site.listener.note(RESET)
    answer = client.call_async(Trigger.Request())
    site.until(answer.done, "the answer")
    site.until(lambda: site.jumps == 1, "a jump")
    site.until_it_drives()


# what the recording says


@dataclass(frozen=True)
class Outage:
    """What was done to a node, and that it was undone; the next outage begins at a log time `until` [s]."""

    kind: str
    begin: Event
    end: Event
    until: float

    @property
    def lasted(self) -> float:
        """How long [s]: in log time for the clock, without which simulated time stands still, else in that."""
        return self.end.log - self.begin.log if self.kind == "clock" else self.end.now - self.begin.now


@dataclass(frozen=True)
class Stop:
    """What an outage led to: the robot moved for so long after its begin, and might have for so long [s].

    It moved again so long after its end [s].
    """

    kind: str
    moved: float
    promised: float
    to_recovery: float


def is_begin(event: Event) -> bool:
    return event.text.split()[0] not in (RESTART, "SIGCONT")


def outages(drive: Drive) -> list[Outage]:
    """Return what was done to the nodes; a clock that is set back is no outage."""
    kinds = {name: kind for kind, name in KINDS.items()}
    done = [event for event in drive.events if event.text != RESET]
    begins = [event.log for event in drive.events if is_begin(event)]
    last = float(drive.poses[-1, 0])
    return [
        Outage(
            kinds[begin.text.split()[1]], begin, end, min((t for t in begins if t > end.log), default=last)
        )
        for begin, end in zip(done[::2], done[1::2], strict=True)
    ]


def stop_of(drive: Drive, outage: Outage) -> Stop:
    """Return what the recording says of an outage."""
    motions, begin, end = drive.motions(), outage.begin, outage.end
    during = (motions.log > begin.log) & (motions.log < end.log)
    after = motions.log[(motions.log > end.log) & (motions.log < outage.until)]
    times = motions.log - begin.log if outage.kind == "clock" else motions.end - begin.now
    # Without a scanner the planner goes on certifying; of the others one decision may have been under way.
    latest = math.inf if outage.kind == "lms200" else begin.now + INTERVAL
    return Stop(
        outage.kind,
        float(times[during].max(initial=0.0)),
        drive.window_end(end.log, latest) - begin.now,
        float(after.min(initial=math.inf)) - end.log,
    )


def judge_kill(drive: Drive, outage: Outage) -> Stop:
    """See that the robot drove, stood inside its window and until the restart, and drove again."""
    stop, motions = stop_of(drive, outage), drive.motions()
    before = np.flatnonzero(motions.log <= outage.begin.log)[-6:]
    assert 0.0 <= outage.begin.now - motions.end[before[-1]] < STILL, outage
    assert np.linalg.norm((motions.after - motions.before)[before], axis=1).sum() > 0.1, outage
    assert stop.moved <= stop.promised, stop
    assert stop.moved <= outage.lasted - 0.5 * STILL, (stop, outage)
    judge_recovery(drive, outage)
    return stop


def judge_recovery(drive: Drive, outage: Outage) -> None:
    """See that the robot drove after the end of an outage."""
    assert drive.distance(outage.end.log, outage.until) > 0.1, outage


def judge_drive(drive: Drive, scene: Scene) -> None:
    """See that no motion was without a window, none too near to a wall, and none while time began anew."""
    motions = drive.motions()
    assert len(motions.log) > 20
    assert len(motions.outside()) == 0, f"outside windows by {motions.outside()} s"
    ways = shapely.linestrings(np.stack((motions.before, motions.after), axis=1))
    walls = shapely.Polygon(scene.border.vertices).boundary
    assert shapely.distance(ways, walls).min() >= scene.safety_margin
    assert (drive.restarts() < 1e-9).all()


def read_and_draw(folder: FilePath) -> Drive:
    """Read the recording back, see that it is whole, and draw beside it what happened after every event."""
    with BagReader(folder / "bag") as bag:
        assert bag.topics.keys() == {f"/{topic.strip('/')}" for _, topic, _ in Listener.TOPICS} | {"/events"}
    drive = read_drive(folder / "bag", "cart")
    last = float(drive.poses[-1, 0])
    stops = {outage.begin: stop_of(drive, outage) for outage in outages(drive)}
    begins = [event for event in drive.events if is_begin(event)]
    ends = [event.log for event in begins[1:]] + [last]
    for number, (event, end) in enumerate(zip(begins, ends, strict=True), start=1):
        title = f"0 s: {event.text}, {event.log:.2f} s from the start of the recording"
        if event in stops:
            stop = stops[event]
            title += f"; moved for {stop.moved:.2f} s, was certified for {stop.promised:.2f} s"
        curves = window_curves(drive, max(0.0, event.log - 3.0), min(end + 1.0, last), zero=event.log)
        draw_window(title, curves, folder / f"{number:02}_{event.text.replace(' ', '_')}.png")
    return drive


def test_kill_of_any_node_stops_the_robot_inside_its_window_and_a_restart_lets_it_go_on(
    tmp_path: FilePath, ros_domain: int
) -> None:
    with site(tmp_path, ros_domain) as here:
        for kind in KINDS:
            kill_and_restart(here, kind)
    drive = read_and_draw(tmp_path)
    judge_drive(drive, here.scene)
    assert [outage.kind for outage in outages(drive)] == list(KINDS)
    for outage in outages(drive):
        judge_kill(drive, outage)
    assert len(drive.jumps) == 1  # the clock began anew
    said = {remark.text for remark in drive.remarks}
    assert any(text.startswith("tracker cart: the certificate ended at") for text in said)
    assert any(text.startswith("robot cart: the unoccupied area is") for text in said)


def test_nodes_that_sleep_and_wake_and_a_clock_that_is_set_back(tmp_path: FilePath, ros_domain: int) -> None:
    with site(tmp_path, ros_domain) as here:
        for kind in KINDS:
            nap(here, kind)
        set_back_the_clock(here)
    drive = read_and_draw(tmp_path)
    judge_drive(drive, here.scene)
    naps = outages(drive)
    assert [outage.kind for outage in naps] == list(KINDS)
    for outage in naps:
        assert outage.lasted > 0.9 * NAP, outage
        judge_recovery(drive, outage)
    (jump,) = drive.jumps  # by hand, and none because of a nap
    reset = drive.events[-1]
    assert reset.text == RESET
    assert reset.log < jump
    said = {remark.text for remark in drive.remarks if remark.log > jump}
    assert any("tracker cart: the clock jumped back" in text for text in said)
    assert drive.distance(float(jump), float(drive.poses[-1, 0])) > 0.1


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS)
def test_series_of_kills(
    tmp_path: FilePath, ros_domain: int, kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with site(tmp_path, ros_domain) as here:
        for _ in range(20):
            kill_and_restart(here, kind)
    drive = read_and_draw(tmp_path)
    judge_drive(drive, here.scene)
    stops = [judge_kill(drive, outage) for outage in outages(drive)]
    assert len(stops) == 20
    times = np.array([[stop.moved, stop.promised, stop.to_recovery] for stop in stops])
    p50, p99 = np.percentile(times, [50, 99], axis=0)
    with capfd.disabled():
        print(
            f"\n{kind}: {len(stops)} kills, to standstill p50 {p50[0]:.2f} p99 {p99[0]:.2f} s, promised p50 "
            f"{p50[1]:.2f} least {times[:, 1].min():.2f} s, least left {(times[:, 1] - times[:, 0]).min():.2f} s; "
            f"restart to driving p50 {p50[2]:.2f} p99 {p99[2]:.2f} s; bag and pictures in {tmp_path}"
        )
