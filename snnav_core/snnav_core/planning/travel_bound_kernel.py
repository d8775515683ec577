"""The search for the earliest arrivals among moving polygons, compiled.

A *group* is all that moves with one velocity: the segments of its outline where they are at the start, the body on no
particular side. A *node* is a corner of a group that sticks out into the free space, or the start, or the target.
"""

from __future__ import annotations

import heapq
import math

import numba
import numpy as np

__all__ = ["START", "TARGET", "earliest_arrivals", "free_intervals", "nodes_of"]

_TOUCH = 1e-9  # [m]
_INSTANT = 1e-9  # [s]
START, TARGET = 0, 1


@numba.njit(cache=True, error_model="numpy")
def free_intervals(places, owners, velocities, segments, offsets, inverted, absent):  # type: ignore[no-untyped-def]
    """When every node is outside of all other groups.

    Parameters
    ----------
    places : ndarray, shape (K, 2)
        Nodes at the start [m].
    owners : ndarray of int, shape (K,)
        Group of each; -1 for a place that stands and belongs to none.
    velocities : ndarray, shape (G, 2)
        [m/s]
    segments : ndarray, shape (M, 4)
        Those of group g are ``segments[offsets[g] : offsets[g + 1]]`` [m].
    inverted : ndarray of bool, shape (G,)
        Whether the group is what lies outside of its outline.
    absent : int
        A group that is not there; -1 for none.

    Returns
    -------
    spans : ndarray, shape (I, 2)
        Begin and end [s] after the start, in order.
    first : ndarray of int, shape (K + 1,)
        Those of node k are ``spans[first[k] : first[k + 1]]``.
    left : ndarray of int, shape (I,)
        The group that covers the node last before; -1 for none.
    """
    first = np.zeros(len(places) + 1, dtype=np.int64)
    spans, left = np.empty((4 * len(places), 2)), np.empty(4 * len(places), dtype=np.int64)
    count = 0
    times, steps = np.empty(len(segments)), np.empty(len(segments), dtype=np.int64)
    for k in range(len(places)):
        covers, events = 0, 0
        for g in range(len(velocities)):
            if g == owners[k] or g == absent:
                continue
            vx, vy = -velocities[g, 0], -velocities[g, 1]
            if owners[k] >= 0:
                vx, vy = vx + velocities[owners[k], 0], vy + velocities[owners[k], 1]
            found, inside = _crossings(places[k], vx, vy, segments, offsets[g], offsets[g + 1], times, events)
            inside = inside != inverted[g]
            covers += inside
            _sort(times, steps, events, found)
            for e in range(events, found):
                inside = not inside
                steps[e] = g + 1 if inside else -g - 1
            events = found
        _sort(times, steps, 0, events)
        begin, last = 0.0, -1
        for e in range(events + 1):
            time = times[e] if e < events else math.inf
            if covers == 0 and time > begin + _INSTANT:
                if count == len(spans):
                    spans = np.concatenate((spans, np.empty_like(spans)))
                    left = np.concatenate((left, np.empty_like(left)))
                if count > first[k] and begin <= spans[count - 1, 1] + _INSTANT:
                    spans[count - 1, 1] = time
                else:
                    spans[count, 0], spans[count, 1], left[count] = begin, time, last
                    count += 1
            if e < events:
                covers += 1 if steps[e] > 0 else -1
                begin, last = time, abs(steps[e]) - 1
        first[k + 1] = count
    return spans[:count], first, left[:count]


@numba.njit(cache=True, error_model="numpy")
def _sort(times, steps, low, high):  # type: ignore[no-untyped-def]
    """Sort a few times, and what belongs to them."""
    for i in range(low + 1, high):
        time, step, j = times[i], steps[i], i
        while j > low and times[j - 1] > time:
            times[j], steps[j] = times[j - 1], steps[j - 1]
            j -= 1
        times[j], steps[j] = time, step


@numba.njit(cache=True, error_model="numpy")
def _crossings(place, vx, vy, segments, low, high, times, count):  # type: ignore[no-untyped-def]
    """Append when a place that moves crosses an outline; also whether it is inside the outline at the start."""
    speed = math.hypot(vx, vy)
    stands = speed < _TOUCH
    if stands:
        vx, vy, speed = 1.0, 0.0, 1.0
    inside = False
    for s in range(low, high):
        px, py = segments[s, 0] - place[0], segments[s, 1] - place[1]
        qx, qy = segments[s, 2] - place[0], segments[s, 3] - place[1]
        p_side, q_side = vx * py - vy * px, vx * qy - vy * qx
        if (p_side > 0.0) == (q_side > 0.0):
            continue
        share = p_side / (p_side - q_side)
        along = vx * (px + share * (qx - px)) + vy * (py + share * (qy - py))
        if along > 0.0:
            inside = not inside
            if not stands:
                times[count] = along / (speed * speed)
                count += 1
    return count, inside


@numba.njit(cache=True, error_model="numpy")
def earliest_arrivals(corners, world, spans, first, speed, seeds, through, until, absent):  # type: ignore[no-untyped-def]
    """Arrival in every interval of every node: label setting by A*, sight is tested when it matters.

    Parameters
    ----------
    corners : tuple of ndarray
        Places and owners, see `free_intervals`, of nodes: 0 is the start, 1 the target. Then before and after, shape
        (K, 2): directions from a corner to its neighbours on the outline; zero for what is no corner.
    world : tuple of ndarray
        Velocities, segments and offsets, see `free_intervals`. Then circles, shape (G, 3): centre and radius [m]
        around each group at the start.
    spans, first
        As `free_intervals` returns them.
    speed : float
        Of the robot, more than that of any group [m/s].
    seeds : ndarray of int
        Intervals at whose begin the robot can be somewhere: that of the start, and where it may have waited.
    through : int
        Number of nodes, the first ones, that ways lead through. With all of them the search ends at the target.
    until : float
        The search ends at this time [s].
    absent : int
        A group that is not there; -1 for none.

    Returns
    -------
    reached : ndarray, shape (I,)
        Times [s] after the start; infinite where nothing leads, or what is farther than the target.
    parents : ndarray of int, shape (I,)
        The interval that each is reached from; -1 for start, and for waiting.
    """
    (places, owners, before, after), (velocities, segments, offsets, circles) = corners, world
    reached = np.full(len(spans), math.inf)
    parents = np.full(len(spans), -1, dtype=np.int64)
    nodes = nodes_of(first)
    hurry = speed if through == len(places) else math.inf
    # What is waiting: label, the one it comes from (-1: none), and time.
    size = len(seeds) + 256
    labels, origins, times = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64), np.empty(size)
    queue = [(math.inf, 0)]
    for count, label in enumerate(seeds):
        labels[count], origins[count], times[count] = label, -1, spans[label, 0]
        rest = _rest(places, owners, velocities, nodes[label], times[count], hurry)
        heapq.heappush(queue, (times[count] + rest, count))
    count = len(seeds)
    here, there = np.empty(2), np.empty(2)
    while queue[0][0] <= until:
        _, entry = heapq.heappop(queue)
        label, parent, time = labels[entry], origins[entry], times[entry]
        if reached[label] < math.inf:
            continue
        node = nodes[label]
        _at(places, owners, velocities, node, time, here)
        if parent >= 0:
            _at(places, owners, velocities, nodes[parent], reached[parent], there)
            if not _is_free(
                there, reached[parent], here, time, velocities, segments, offsets, circles, absent
            ):
                continue
        reached[label], parents[label] = time, parent
        if node == TARGET and through == len(places):
            break
        if node >= through:
            continue
        for other in range(TARGET, len(places)):
            if other == node:
                continue
            arrival = time + _meets(here, time, places[other], _of(velocities, owners[other]), speed)
            found = _span_of(spans, first, other, arrival)
            if found < 0 or reached[found] < math.inf:
                continue
            _at(places, owners, velocities, other, arrival, there)
            wx, wy, lasts = there[0] - here[0], there[1] - here[1], arrival - time
            if not _turns(wx, wy, lasts, node, owners, velocities, before, after, parent < 0):
                continue
            if _turns(wx, wy, lasts, other, owners, velocities, before, after, False):
                rest = _rest(places, owners, velocities, other, arrival, hurry)
                labels, origins, times = _room(labels, origins, times, count)
                labels[count], origins[count], times[count] = found, label, arrival
                heapq.heappush(queue, (arrival + rest, count))
                count += 1
    return reached, parents


@numba.njit(cache=True, error_model="numpy")
def nodes_of(first):  # type: ignore[no-untyped-def]
    """The node of every interval."""
    nodes = np.empty(first[-1], dtype=np.int64)
    for k in range(len(first) - 1):
        nodes[first[k] : first[k + 1]] = k
    return nodes


@numba.njit(cache=True, error_model="numpy")
def _room(labels, origins, times, count):  # type: ignore[no-untyped-def]
    """Twice the room where there is none left."""
    if count < len(times):
        return labels, origins, times
    return (
        np.concatenate((labels, labels)),
        np.concatenate((origins, origins)),
        np.concatenate((times, times)),
    )


@numba.njit(cache=True, error_model="numpy")
def _of(velocities, owner):  # type: ignore[no-untyped-def]
    return (velocities[owner, 0], velocities[owner, 1]) if owner >= 0 else (0.0, 0.0)


@numba.njit(cache=True, error_model="numpy")
def _at(places, owners, velocities, node, time, out):  # type: ignore[no-untyped-def]
    vx, vy = _of(velocities, owners[node])
    out[0], out[1] = places[node, 0] + vx * time, places[node, 1] + vy * time


@numba.njit(cache=True, error_model="numpy")
def _rest(places, owners, velocities, node, time, speed):  # type: ignore[no-untyped-def]
    """Least time from a node to the target [s]."""
    vx, vy = _of(velocities, owners[node])
    x, y = places[node, 0] + vx * time, places[node, 1] + vy * time
    return math.hypot(x - places[TARGET, 0], y - places[TARGET, 1]) / speed


@numba.njit(cache=True, error_model="numpy")
def _meets(here, time, place, velocity, speed):  # type: ignore[no-untyped-def]
    """How long a robot takes from a point and time to a node that moves [s]."""
    ux, uy = velocity
    dx, dy = place[0] + ux * time - here[0], place[1] + uy * time - here[1]
    along = dx * ux + dy * uy
    faster = speed * speed - ux * ux - uy * uy
    return (along + math.sqrt(along * along + faster * (dx * dx + dy * dy))) / faster


@numba.njit(cache=True, error_model="numpy")
def _span_of(spans, first, node, time):  # type: ignore[no-untyped-def]
    for label in range(first[node], first[node + 1]):
        if spans[label, 0] - _INSTANT <= time <= spans[label, 1] + _INSTANT:
            return label
    return -1


@numba.njit(cache=True, error_model="numpy")
def _turns(wx, wy, lasts, node, owners, velocities, before, after, anyhow):  # type: ignore[no-untyped-def]
    """Whether a way touches the corner of a node from one side; `anyhow`: whether it does not lead into the body.

    The way is (wx, wy) and takes `lasts`; it is looked at from the group of the node.
    """
    if owners[node] < 0:
        return True
    vx, vy = _of(velocities, owners[node])
    wx, wy = wx - vx * lasts, wy - vy * lasts
    tolerance = _TOUCH * math.hypot(wx, wy)
    near = wx * before[node, 1] - wy * before[node, 0]
    far = wx * after[node, 1] - wy * after[node, 0]
    if abs(near) <= tolerance or abs(far) <= tolerance or (near > 0.0) == (far > 0.0):
        return True
    ahead = wx * (before[node, 0] + after[node, 0]) + wy * (before[node, 1] + after[node, 1])
    return anyhow and ahead < 0.0


@numba.njit(cache=True, error_model="numpy")
def _is_free(here, begin, there, end, velocities, segments, offsets, circles, absent):  # type: ignore[no-untyped-def]
    """Whether no outline stands in the way of a robot that moves straight from a point and time to another."""
    for g in range(len(velocities)):
        if g == absent:
            continue
        vx, vy = velocities[g]
        ax, ay = here[0] - vx * begin, here[1] - vy * begin
        dx, dy = there[0] - vx * end - ax, there[1] - vy * end - ay
        length = math.sqrt(dx * dx + dy * dy)
        if length <= _TOUCH:
            continue
        dx, dy = dx / length, dy / length
        cx, cy, radius = circles[g, 0] - ax, circles[g, 1] - ay, circles[g, 2]
        along = min(max(dx * cx + dy * cy, 0.0), length)
        if math.hypot(cx - along * dx, cy - along * dy) > radius:
            continue
        for s in range(offsets[g], offsets[g + 1]):
            px, py = segments[s, 0] - ax, segments[s, 1] - ay
            qx, qy = segments[s, 2] - ax, segments[s, 3] - ay
            p_side, q_side = dx * py - dy * px, dx * qy - dy * qx
            if (p_side > _TOUCH and q_side > _TOUCH) or (p_side < -_TOUCH and q_side < -_TOUCH):
                continue
            p_along, q_along = dx * px + dy * py, dx * qx + dy * qy
            if abs(p_side) <= _TOUCH:
                # a corner on the way: the parts on both sides of it are ways of their own
                if _TOUCH < p_along < length - _TOUCH:
                    return False
            elif abs(q_side) > _TOUCH:
                crossing = p_along + (q_along - p_along) * p_side / (p_side - q_side)
                if _TOUCH < crossing < length - _TOUCH:
                    return False
    return True
