"""Where a robot is at the instant of a decision, measured a little earlier (C3-33), and what is left of its path."""

from __future__ import annotations

import math

import numpy as np

from snnav_core.types import (
    TIME_TOLERANCE,
    FloatArray,
    HeardPath,
    PlannedPath,
    Pose2D,
    RobotSpec,
    RobotState,
    TimedPath,
)

__all__ = ["halted", "onwards", "predicted_pose", "state_fault", "up_to"]


def predicted_pose(robot: RobotSpec, state: RobotState, plan: PlannedPath | None, time: float) -> Pose2D:
    """Return the pose of a robot that has followed its last path since its state was measured.

    Parameters
    ----------
    robot : RobotSpec
    state : RobotState
    plan : PlannedPath or None
        What it follows; None for a robot that stands.
    time : float
        Of the decision [s].

    Returns
    -------
    Pose2D
        The measured pose [map], shifted by what the path goes on between the measurement and the decision, within the
        validity of the path; a robot that turns in place has turned on.

    Notes
    -----
    Deviation C3-33: odometry is a little older than the decision. In lockstep it is not, and nothing changes.
    """
    if plan is None or time - state.stamp <= TIME_TOLERANCE:
        return state.pose
    until = min(time, plan.certificate.valid_until)
    since = max(state.stamp, plan.path.start_time)
    if until <= since:
        return state.pose
    pose = state.pose
    if plan.path.turn_to is not None:
        left = math.remainder(plan.path.turn_to - pose.heading, 2.0 * math.pi)
        reach = robot.max_turn_rate * (until - since)
        return Pose2D(pose.x, pose.y, pose.heading + min(max(left, -reach), reach))
    times = np.array([since, until])
    there, ahead = plan.path.positions_at(times)[:, :2]
    x, y = (pose.position + ahead - there).tolist()
    before, after = _tangents(plan.path, times)
    return Pose2D(x, y, pose.heading + after - before)


def _tangents(path: TimedPath, times: FloatArray) -> FloatArray:
    """Headings of a path at times (N,) [s], as if arcs led through its points, shape (N,) [rad, unwrapped]."""
    links = np.diff(path.points[:, :2], axis=0)
    if len(links) == 0:
        return np.zeros(len(times))
    chords = np.unwrap(np.arctan2(links[:, 1], links[:, 0]))
    inner = 0.5 * (chords[:-1] + chords[1:])
    first = 2.0 * chords[0] - inner[0] if len(inner) else chords[0]
    last = 2.0 * chords[-1] - inner[-1] if len(inner) else chords[-1]
    vertices = np.concatenate(([first], inner, [last]))
    headings: FloatArray = np.interp(
        (times - path.start_time) / path.step, np.arange(len(vertices)), vertices
    )
    return headings


def state_fault(state: RobotState | None, time: float, interval: float) -> str:
    """Why a measured state cannot be used at `time` [s], one `interval` [s] old at most, or an empty string."""
    if state is None:
        return "is missing"
    if not abs(time - state.stamp) <= interval + TIME_TOLERANCE:
        return f"was measured {time - state.stamp:.2f} s ago"
    pose = state.pose
    if not all(math.isfinite(value) for value in (pose.x, pose.y, pose.heading)):
        return f"is ({pose.x}, {pose.y}, {pose.heading})"
    return ""


def up_to(path: TimedPath, end: float) -> TimedPath:
    """The part of a path up to time `end` [s], where the robot stops without a new one."""
    count = math.floor((end - path.start_time + TIME_TOLERANCE) / path.step) + 1
    return path if count >= len(path) else TimedPath(path.start_time, path.step, path.points[: max(count, 1)])


def onwards(path: TimedPath, start: float) -> TimedPath:
    """The part of a path from a time [s] inside it on."""
    if path.start_time >= start - TIME_TOLERANCE:
        return path
    count = max(1, math.ceil((path.end_time - start) / path.step - 1e-6) + 1)
    times = start + path.step * np.arange(count, dtype=np.float64)
    return TimedPath(start, path.step, path.positions_at(times), path.turn_to)


def halted(promise: HeardPath, time: float) -> HeardPath:
    """What is left of a promise when the robot was stopped at a time [s]: it stands where it was to be then."""
    if promise.path is None:
        return promise
    here = promise.path.positions_at(np.array([time]))
    return HeardPath(TimedPath(time, promise.path.step, here), promise.valid_until)
