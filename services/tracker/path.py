"""The route's path: smooth, in sections driven one way each, with the robot's place on it.

The poses of a long route drift, and a route over hills is no plane curve. Neither matters to a tracker, which needs
the path only near the trunk: every step from a vertex to the next is laid down, with its length, in the plane of the
vertex it starts from, so that the path is developed into one plane once, when the route arrives. A robot near vertex
i is placed by ``T_i_robot`` in the plane of that vertex, and only what lies along the path near it is ever compared
with it: errors that have accumulated elsewhere move the whole picture and cancel out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.geometry import inverse, is_transform, yaw_of
from services.tracker.smoothing import SmoothingSettings, smooth

Array = NDArray[np.float64]


_FARTHEST = 100.0
"""Metres from the trunk beyond which a pose is an error: vertices are decimetres apart."""


class RouteError(ValueError):
    """A route that has no vertex, or a pose that is none on it."""


@dataclass(frozen=True, slots=True)
class PathSettings:
    """How a path is made and searched: metres and radians.

    Attributes:
        smoothing: how the taught points become a curve.
        still: a step shorter than this tells nothing about the direction of driving.
        turn: where so short a step turns by more than this, the robot turned on the spot.
        overlap: a vertex that lies no farther behind the one before, and is passed at once, is no change of direction:
            two maps meet there, or localization has said it a little differently.
        search: the robot is looked for no further than this along the path from the trunk.
    """

    smoothing: SmoothingSettings = field(default_factory=SmoothingSettings)
    still: float = 0.06
    turn: float = 0.12
    overlap: float = 0.3
    search: float = 2.0


@dataclass(frozen=True, slots=True)
class Section:
    """A stretch that is driven one way without a stop; arrays (M,), ``s`` counts from the start of the route.

    ``heading`` is the direction of travel, so the robot's own heading is opposite where ``direction`` is -1;
    ``curvature`` is positive where the direction of travel turns left.
    """

    direction: int
    first_vertex: int
    last_vertex: int
    s: Array
    x: Array
    y: Array
    heading: Array
    curvature: Array

    @property
    def start(self) -> float:
        """Arclength of its start, metres."""
        return float(self.s[0])

    @property
    def end(self) -> float:
        """Arclength of its end, metres."""
        return float(self.s[-1])

    def robot_heading(self, s: float) -> float:
        """The taught heading of the robot itself at ``s``, radians."""
        heading = float(np.interp(s, self.s, self.heading))
        return heading if self.direction > 0 else heading + math.pi


@dataclass(frozen=True, slots=True)
class Projection:
    """A robot's place beside a path: ``s`` of the nearest point (m), and the errors from there.

    ``lateral`` (m) is positive to the left as seen along the direction of travel; ``heading`` (rad), in (-pi, pi], is
    the robot's heading less the taught one. Beyond either end of a section ``s`` runs on along the tangent.
    """

    s: float
    lateral: float
    heading: float


@dataclass(frozen=True, slots=True)
class Path:
    """A developed path: ``vertices`` (N, 3) as x, y, heading; their arclength ``vertex_s`` (N,); its sections."""

    vertices: Array
    vertex_s: Array
    sections: tuple[Section, ...]
    search: float

    @property
    def length(self) -> float:
        """Metres from start to end; 0 for a route that goes nowhere."""
        return self.sections[-1].end if self.sections else 0.0

    def place(self, trunk_index: int, T_trunk_robot: ArrayLike) -> tuple[float, float, float]:
        """The robot's x, y (m) and heading (rad) in the developed plane, from its pose (4, 4) in the trunk's frame.

        Raises:
            RouteError: the route has no such vertex, or the pose is none near it.
        """
        T = pose_at_trunk(trunk_index, T_trunk_robot, len(self.vertices))
        x, y, heading = (float(value) for value in self.vertices[trunk_index])
        c, s = math.cos(heading), math.sin(heading)
        return x + c * T[0, 3] - s * T[1, 3], y + s * T[0, 3] + c * T[1, 3], heading + float(yaw_of(T))

    def section_of(self, trunk_index: int) -> int:
        """Index of the section that a vertex lies on: the later one where two meet."""
        starts = [section.first_vertex for section in self.sections]
        return max(int(np.searchsorted(starts, trunk_index, side="right")) - 1, 0)

    def project(self, section_index: int, trunk_index: int, pose: tuple[float, float, float]) -> Projection:
        """The place on one section of a robot at x, y, heading of the developed plane (see :meth:`place`).

        Only the stretch near the trunk is looked at, so that a route that crosses itself is never taken for another
        part of itself.
        """
        section = self.sections[section_index]
        x, y, heading = pose
        middle = min(max(float(self.vertex_s[trunk_index]), section.start), section.end)
        first = max(int(np.searchsorted(section.s, middle - self.search)) - 1, 0)
        last = min(int(np.searchsorted(section.s, middle + self.search)) + 1, len(section.s))
        s = _nearest(section, x, y, first, last)
        taught = float(np.interp(s, section.s, section.heading))
        over = s - min(max(s, section.start), section.end)
        px = float(np.interp(s, section.s, section.x)) + over * math.cos(taught)
        py = float(np.interp(s, section.s, section.y)) + over * math.sin(taught)
        lateral = (y - py) * math.cos(taught) - (x - px) * math.sin(taught)
        return Projection(s, lateral, wrap(heading - section.robot_heading(s)))


def pose_at_trunk(trunk_index: int, T_trunk_robot: ArrayLike, vertices: int) -> Array:
    """``T_trunk_robot`` (4, 4), if it can be the pose of a robot near a vertex of a route with so many ``vertices``.

    Raises:
        RouteError: the route has no such vertex, or the pose is no finite rigid transform or far away from it.
    """
    if not 0 <= trunk_index < vertices:
        raise RouteError(f"The trunk is vertex {trunk_index}, but the route has {vertices} vertices.")
    T = np.asarray(T_trunk_robot, dtype=np.float64)
    if T.shape != (4, 4) or not is_transform(T, 1e-3):
        raise RouteError("The robot's pose in the trunk's frame is not a finite rigid transform.")
    away = float(np.abs(T[:3, 3]).max())
    if away > _FARTHEST:
        raise RouteError(f"The robot's pose is {away:.3g} m away from its trunk; it cannot be more than {_FARTHEST:g}.")
    return T


def wrap(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


def _nearest(section: Section, x: float, y: float, first: int, last: int) -> float:
    """Arclength of the point of the samples [first, last) that is nearest to (x, y)."""
    xs, ys, ss = section.x[first:last], section.y[first:last], section.s[first:last]
    dx, dy, ds = np.diff(xs), np.diff(ys), np.diff(ss)
    along = ((x - xs[:-1]) * dx + (y - ys[:-1]) * dy) / np.maximum(dx * dx + dy * dy, 1e-12)
    inside = np.clip(along, 0.0, 1.0)
    squared = (xs[:-1] + inside * dx - x) ** 2 + (ys[:-1] + inside * dy - y) ** 2
    best = int(np.argmin(squared))
    piece = first + best
    # Only at the true ends of a section does the path run on along its tangent.
    low = -np.inf if piece == 0 else 0.0
    high = np.inf if piece == len(section.s) - 2 else 1.0
    return float(ss[best] + np.clip(along[best], low, high) * ds[best])


def make_path(T_0_i: ArrayLike, settings: PathSettings | None = None) -> Path:
    """The path of a route, from the poses (N, 4, 4) of its vertices, N >= 1, in the first one's frame or any other.

    Raises:
        RouteError: there is no vertex, or a pose is no finite rigid transform.
    """
    settings = settings or PathSettings()
    T = np.asarray(T_0_i, dtype=np.float64)
    if T.ndim != 3 or len(T) == 0 or not is_transform(T, 1e-3):
        raise RouteError(f"A route needs the poses (N, 4, 4) of its vertices, got an array of shape {T.shape}.")
    vertices = _develop(T)
    kept = _passed(vertices, settings)
    relative = inverse(T[kept[:-1]]) @ T[kept[1:]]
    step, turn = np.linalg.norm(relative[:, :3, 3], axis=1), yaw_of(relative)
    sections: list[Section] = []
    kept_s = np.zeros(len(kept))
    start = 0.0
    for first, last, direction in _split(step, relative[:, 0, 3], turn, settings):
        curve = smooth(vertices[kept[first : last + 1], :2], settings.smoothing)
        x, y = curve.xy[:, 0], curve.xy[:, 1]
        ends = int(kept[first]), int(kept[last])
        section = Section(direction, *ends, start + curve.s, x, y, curve.heading, curve.curvature)
        sections.append(section)
        kept_s[first : last + 1] = start + curve.point_s
        kept_s[last + 1 :] = start = section.end
    vertex_s = kept_s[np.searchsorted(kept, np.arange(len(T)), side="right") - 1]
    return Path(vertices, vertex_s, tuple(sections), settings.search)


def _passed(vertices: Array, settings: PathSettings) -> NDArray[np.int64]:
    """Indices of the vertices that the path goes through, of all (N, 3) in the developed plane.

    Left out are those that lie beside or a little behind the one before while the route goes on past it: through them
    the path would be a loop of centimetres.
    """
    forward = _forward(vertices)
    moving = np.abs(forward) >= settings.still
    last_moving = np.maximum.accumulate(np.where(moving, np.arange(len(forward)), -1))
    direction = np.where(last_moving < 0, 0.0, np.sign(forward[last_moving]))
    kept = np.ones(len(vertices), dtype=np.bool_)
    for i in np.flatnonzero(~moving[1:-1] | (direction[1:-1] != direction[:-2])) + 2:
        before = i - 1
        while not kept[before]:
            before -= 1
        way = direction[before - 1] if before > 0 else 0.0
        kept[i] = way == 0.0 or not _is_overlap(way, _seen_from(vertices[before], vertices[i : i + 2]), settings)
    return np.flatnonzero(kept)


def _forward(vertices: Array) -> Array:
    """How far (N-1,) each vertex lies before the one before, along that one's heading."""
    dx, dy = np.diff(vertices[:, :2], axis=0).T
    return np.asarray(np.cos(vertices[:-1, 2]) * dx + np.sin(vertices[:-1, 2]) * dy)


def _is_overlap(direction: float, ahead: Array, settings: PathSettings) -> bool:
    """Whether the first of two poses (2, 3) is no step in the direction of travel, and the second is one again."""
    (x, y, turn), (x_next, _, _) = ahead
    near = -settings.overlap <= direction * x < settings.still and abs(y) <= settings.overlap / 2.0
    return bool(near and abs(turn) <= settings.turn and direction * x_next >= settings.still)


def _seen_from(place: Array, vertices: Array) -> Array:
    """Poses (N, 3) of the plane in the frame of one of them."""
    dx, dy = (vertices[:, :2] - place[:2]).T
    c, s = math.cos(place[2]), math.sin(place[2])
    return np.stack([c * dx + s * dy, c * dy - s * dx, vertices[:, 2] - place[2]], axis=1)


def _develop(T: Array) -> Array:
    """Vertices (N, 3) as x, y, heading in the developed plane."""
    relative = inverse(T[:-1]) @ T[1:]
    translation = relative[:, :3, 3]
    step = np.linalg.norm(translation, axis=1)
    turn = yaw_of(relative)
    heading = np.concatenate([[0.0], np.cumsum(turn)])
    bearing = heading[:-1] + np.arctan2(translation[:, 1], translation[:, 0])
    x = np.concatenate([[0.0], np.cumsum(step * np.cos(bearing))])
    y = np.concatenate([[0.0], np.cumsum(step * np.sin(bearing))])
    return np.stack([x, y, heading], axis=1)


def _split(step: Array, forward: Array, turn: Array, settings: PathSettings) -> list[tuple[int, int, int]]:
    """Sections as (first vertex, last vertex, direction): cut at changes of direction and at turns on the spot."""
    sections: list[tuple[int, int, int]] = []
    first, direction = 0, 0
    for i in range(len(step)):
        moving = step[i] >= settings.still
        spinning = not moving and abs(turn[i]) > settings.turn
        sign = (1 if forward[i] > 0.0 else -1) if moving else direction
        if spinning or direction not in {0, sign}:
            if direction != 0:
                sections.append((first, i, direction))
            first, direction = (i + 1, 0) if spinning else (i, sign)
        else:
            direction = sign
    if direction != 0:
        sections.append((first, len(step), direction))
    return sections
