"""Where the vertices of a relative pose graph are drawn: one plane for all of them.

A pose graph has no common frame. For drawing, each map is chained from its temporal edges, pinned wherever an edge
joins it to a map that is drawn already, and stretched a little between the pins. What no edge joins stands beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.messages import Topology

Array = NDArray[np.float64]
Plane = NDArray[np.float64]
"""(N, 3) or (3,): x and y in metres, yaw in radians."""

_GAP_M = 5.0


@dataclass(frozen=True, slots=True)
class Joint:
    """A spatial edge as map ``of`` sees it: its vertex ``index`` is at ``pose`` from vertex ``at`` of map ``to``."""

    of: int
    index: int
    to: int
    at: int
    pose: Plane


def planar(T: Array) -> Plane:
    """(..., 3) of transforms (..., 4, 4), as seen from above."""
    yaw = np.arctan2(T[..., 1, 0], T[..., 0, 0])
    return np.stack([T[..., 0, 3], T[..., 1, 3], yaw], axis=-1)


def compose(a: Plane, b: Plane) -> Plane:
    """``T_w_b`` of ``T_w_a`` and ``T_a_b``, in the plane; either may be many."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.stack(np.broadcast_arrays(x, y, _wrapped(a[..., 2] + b[..., 2])), axis=-1)


def invert(a: Plane) -> Plane:
    """``T_b_a`` of ``T_a_b``, in the plane."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack([-c * a[..., 0] - s * a[..., 1], s * a[..., 0] - c * a[..., 1], -a[..., 2]], axis=-1)


def lay_out(topology: Topology) -> list[Plane]:
    """The poses (N, 3) of each map's vertices, in the order of the topology's maps."""
    chains = _chains(topology)
    joints = _joints(topology, [len(chain) for chain in chains])
    placed: dict[int, Plane] = {}
    while len(placed) < len(chains):
        ready = [k for k in range(len(chains)) if k not in placed and any(j.to in placed for j in joints[k])]
        if ready:
            k = ready[0]
            pins = {j.index: compose(placed[j.to][j.at], j.pose) for j in joints[k] if j.to in placed}
            placed[k] = _pinned(chains[k], pins)
        else:
            k = next(k for k in range(len(chains)) if k not in placed)
            placed[k] = _beside(_closed(chains[k], [j for j in joints[k] if j.to == k]), placed)
    return [placed[k] for k in range(len(chains))]


def _chains(topology: Topology) -> list[Plane]:
    """Each map on its own, its first vertex at the origin; a step that no edge tells is none."""
    steps = [np.zeros((max(summary.vertices - 1, 0), 3)) for summary in topology.maps]
    edges, plane = topology.edges, planar(topology.T_a_b)
    temporal = (topology.spatial == 0) & (edges[:, 0] == edges[:, 2])
    forwards = temporal & (edges[:, 3] == edges[:, 1] + 1)
    backwards = temporal & (edges[:, 3] == edges[:, 1] - 1)
    for rows, first, step in ((forwards, 1, plane), (backwards, 3, invert(plane))):
        for k in np.unique(edges[rows, 0]):
            mine = rows & (edges[:, 0] == k)
            steps[k][edges[mine, first]] = step[mine]
    return [_chain(one) if summary.vertices else one for one, summary in zip(steps, topology.maps, strict=True)]


def _chain(steps: Plane) -> Plane:
    yaw = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    c, s = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    x = np.concatenate([[0.0], np.cumsum(c * steps[:, 0] - s * steps[:, 1])])
    y = np.concatenate([[0.0], np.cumsum(s * steps[:, 0] + c * steps[:, 1])])
    return np.stack([x, y, _wrapped(yaw)], axis=-1)


def _joints(topology: Topology, sizes: list[int]) -> list[list[Joint]]:
    """The spatial edges of each map, as seen from it."""
    joints: list[list[Joint]] = [[] for _ in sizes]
    spatial = np.flatnonzero(topology.spatial)
    poses = planar(topology.T_a_b[spatial])
    for (k_a, i_a, k_b, i_b), T_a_b in zip(topology.edges[spatial].tolist(), poses, strict=True):
        joints[k_b].append(Joint(k_b, i_b, k_a, i_a, T_a_b))
        joints[k_a].append(Joint(k_a, i_a, k_b, i_b, invert(T_a_b)))
    return joints


def _pinned(chain: Plane, pins: dict[int, Plane]) -> Plane:
    """A chain through its pins: between two of them, what each says, the more the nearer it is."""
    at = np.array(sorted(pins))
    pinned = np.stack([pins[index] for index in at.tolist()])
    index = np.arange(len(chain))
    after = np.searchsorted(at, index, side="left").clip(0, len(at) - 1)
    before = (np.searchsorted(at, index, side="right") - 1).clip(0, len(at) - 1)
    by_before = compose(pinned[before], compose(invert(chain[at[before]]), chain))
    by_after = compose(pinned[after], compose(invert(chain[at[after]]), chain))
    span = at[after] - at[before]
    share = np.where(span > 0, (index - at[before]) / np.maximum(span, 1), 0.0)[:, None]
    between = by_after - by_before
    between[:, 2] = _wrapped(between[:, 2])
    mixed: Plane = by_before + share * between
    return mixed


def _closed(chain: Plane, loops: list[Joint]) -> Plane:
    """A chain that meets itself: what is missing at the meeting is spread over the loop."""
    for loop in loops:
        if loop.at < loop.index:
            chain = _pinned(
                chain, {0: chain[0], loop.at: chain[loop.at], loop.index: compose(chain[loop.at], loop.pose)}
            )
    return chain


def _beside(chain: Plane, placed: dict[int, Plane]) -> Plane:
    """A chain to the right of all that is drawn, for nothing says where it really is."""
    drawn = [poses for poses in placed.values() if len(poses)]
    if not drawn or not len(chain):
        return chain
    right = max(float(poses[:, 0].max()) for poses in drawn)
    moved: Plane = chain + np.array([right + _GAP_M - float(chain[:, 0].min()), 0.0, 0.0])
    return moved


def _wrapped(angle: Array) -> Array:
    wrapped: Array = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped
