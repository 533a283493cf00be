"""Whether covariances are honest: normalised estimation error squared (NEES) of what a run estimated, by the truth.

For errors as large as their covariance says, the NEES of a pose is distributed as chi-square with 6 degrees of freedom
(Y. Bar-Shalom et al., *Estimation with applications to tracking and navigation*, section 5.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from common import geometry
from common.geometry import Array, Uncertain
from services.estimator.offline.localization import Processed, Route


def nees(estimate: Uncertain, truth: Array) -> float:
    """Squared error of a transform by its covariance's own measure."""
    error = geometry.log(estimate.T @ geometry.inverse(truth))
    return float(error @ np.linalg.solve(estimate.covariance, error))


def of_odometry(drive: Sequence[Processed], T_vehicle_camera: Array) -> Array:
    """NEES (N,) of the last motion measured against each keyframe: the longest, and of independent errors."""
    truth = _vehicle_poses(drive, T_vehicle_camera)
    starts = [i for i, (a, b) in enumerate(pairwise(drive)) if a.step.keyframe != b.step.keyframe]
    return np.array(
        [
            nees(drive[last].step.T_keyframe_live, geometry.inverse(truth[first]) @ truth[last])
            for first, last in pairwise(starts)
            if drive[last].step.success
        ]
    )


def of_edges(route: Route) -> Array:
    """NEES (N,) of every other edge between the vertices of a taught route: neighbours share a frame."""
    T_camera_vehicle, memory = geometry.inverse(route.camera.T_vehicle_camera), route.memory
    poses = {vertex: T_world_left @ T_camera_vehicle for vertex, T_world_left in memory.truth.items()}
    edges = memory.graph.edges[::2]
    return np.array([nees(edge.T_a_b, geometry.inverse(poses[edge.a]) @ poses[edge.b]) for edge in edges])


def of_localization(route: Route, drive: Sequence[Processed], apart: int = 4) -> Array:
    """NEES (N,) of the poses that a repeat of a drive tells as successes, one every ``apart`` of them."""
    run, T_vehicle_camera = route.repeat(drive), route.camera.T_vehicle_camera
    live, vertices = _vehicle_poses(drive, T_vehicle_camera), route.memory.route
    out = []
    for i in np.flatnonzero(run.success)[::apart]:
        T_world_vertex = route.memory.truth[vertices[run.trunk[i]]] @ geometry.inverse(T_vehicle_camera)
        estimate = Uncertain(run.T_vertex_live[i], run.covariances[i])
        out.append(nees(estimate, geometry.inverse(T_world_vertex) @ live[i]))
    return np.array(out)


def _vehicle_poses(drive: Sequence[Processed], T_vehicle_camera: Array) -> Array:
    """True poses ``T_world_vehicle`` (N, 4, 4) of a drive.

    Raises:
        ValueError: they are not known.
    """
    truth = [frame.T_world_left for frame in drive]
    if any(T is None for T in truth):
        raise ValueError("errors cannot be told without the truth of every pair")
    return np.asarray(np.array(truth) @ geometry.inverse(T_vehicle_camera))
