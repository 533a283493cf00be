"""Where the robot is and how well it is localized, ten times a second."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from common.ids import VertexId
from common.messages import Localization, Odometry, TrackerStatus
from services.console.robot.models.graph import GraphModel
from services.console.robot.models.layout import Plane, planar


@dataclass(frozen=True, slots=True)
class Heard:
    """The newest messages that are still fresh, None where there is none.

    ``arrival`` is the monotonic time (s) at which the newest of them came.
    """

    arrival: float
    odometry: Odometry | None
    localization: Localization | None
    tracker: TrackerStatus | None
    position: VertexId | None


def drawn_at(heard: Heard, graph: GraphModel) -> tuple[Plane | None, str]:
    """Where the robot is drawn, and by what that is known: localization, odometry, or the navigator's word."""
    found = heard.localization
    if found is not None and (pose := graph.place(found.trunk, planar(found.T_trunk_robot))) is not None:
        return pose, "localization" if found.success else "dead reckoning"
    step = heard.odometry
    if step is not None and step.vertex is not None:
        pose = graph.place(step.vertex, planar(step.T_vertex_robot))
        if pose is not None:
            return pose, "odometry"
    if heard.position is not None and (pose := graph.pose(heard.position)) is not None:
        return pose, "last known"
    return None, ""


def live_section(heard: Heard, graph: GraphModel) -> dict[str, Any]:
    """The figures of this moment: metres, radians, seconds."""
    pose, by = drawn_at(heard, graph)
    live: dict[str, Any] = {"t": round(heard.arrival, 2), "by": by}
    if pose is not None:
        live["pose"] = [round(float(value), 3) for value in pose]
    if heard.odometry is not None:
        live["stamp"] = heard.odometry.stamp
        live["v"] = round(float(heard.odometry.twist[0]), 2)
        live["w"] = round(float(heard.odometry.twist[5]), 2)
        live["tracked"] = heard.odometry.inliers
        live["odometry"] = heard.odometry.success
    if heard.localization is not None:
        live |= _localized(heard.localization)
    if heard.tracker is not None and heard.localization is not None:
        live["remaining"] = round(heard.tracker.remaining, 1)
        live["limit"] = round(heard.tracker.speed_limit, 2)
    if (error := path_error(heard)) is not None:
        live["lateral"], live["heading"] = round(error[0], 3), round(error[1], 3)
    return live


def path_error(heard: Heard) -> tuple[float, float] | None:
    """Metres beside the path and radians off its direction; None where nobody measures them."""
    found = heard.localization
    if found is None:
        return None
    if heard.tracker is not None and heard.tracker.route == found.route and found.metric:
        return heard.tracker.lateral_error, heard.tracker.heading_error
    pose = planar(found.T_trunk_robot)
    return (float(pose[1]), float(pose[2])) if found.metric else None


def series_sample(live: dict[str, Any]) -> list[Any] | None:
    """``[t, path error, inliers, metres since success]`` of a moment in which the robot localizes; else None."""
    if "inliers" not in live:
        return None
    return [live["t"], live.get("lateral"), live["inliers"], live["metres"]]


def _localized(found: Localization) -> dict[str, Any]:
    return {
        "trunk": str(found.trunk),
        "success": found.success,
        "stream": found.stream,
        "streams": dict(found.streams),
        "inliers": found.inliers,
        "metres": round(found.metres_since_success, 2),
        "seconds": round(found.seconds_since_success, 1),
        "why": found.reason,
        "metric": found.metric,
    }
