"""What a point of a path does that touches a barrier: compiled, for the kernels of the plane and of space-time."""

from __future__ import annotations

import numba

__all__ = ["TOUCHING", "push_out"]

TOUCHING = -1e-9
"""From this depth on a point touches a barrier [m]."""


@numba.njit(cache=True, nogil=True)
def push_out(p, velocity, force, i, depth, nx, ny):  # type: ignore[no-untyped-def]
    """Put point i out of what it is in by `depth`; take the inward parts out of velocity and force."""
    if not depth > TOUCHING:
        return
    out = max(depth, 0.0)
    p[i, 0] += out * nx
    p[i, 1] += out * ny
    inward = min(velocity[i, 0] * nx + velocity[i, 1] * ny, 0.0)
    velocity[i, 0] -= inward * nx
    velocity[i, 1] -= inward * ny
    inward = min(force[i, 0] * nx + force[i, 1] * ny, 0.0)
    force[i, 0] -= inward * nx
    force[i, 1] -= inward * ny
