"""Where sensors sit on their vehicle: ROS's static transforms."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from common.geometry import Array, is_transform

_VEHICLES = ("base_link", "base_footprint")
_DEEPEST = 32
_MOST = 4096


class StaticFrames:
    """A tree of frames that do not move against each other."""

    def __init__(self, messages: Iterable[Any] = (), vehicles: tuple[str, ...] = _VEHICLES) -> None:
        """Of the messages of ``/tf_static``; ``vehicles`` are names that the vehicle's own frame may have."""
        self._vehicles = vehicles
        self._above: dict[str, tuple[str, Array]] = {}
        for message in messages:
            self.add(message)

    def add(self, message: Any) -> None:  # noqa: ANN401, a class that rosbags makes at run time
        """Takes another message of ``/tf_static``; what is no transform is left out."""
        for made in message.transforms:
            T = _matrix(made.transform)
            if is_transform(T) and (made.child_frame_id in self._above or len(self._above) < _MOST):
                self._above[_bare(made.child_frame_id)] = _bare(made.header.frame_id), T

    def T_vehicle(self, frame: str) -> Array | None:
        """``T_vehicle_frame`` (4, 4), None where the frame does not hang on the vehicle."""
        T, at = np.eye(4), _bare(frame)
        for _ in range(_DEEPEST):
            if at in self._vehicles:
                return T
            if at not in self._above:
                return None
            at, T_above_at = self._above[at]
            T = T_above_at @ T
        return None


def _bare(frame: str) -> str:
    """A frame's name without ROS 1's slash."""
    return frame.removeprefix("/")


def _matrix(transform: Any) -> Array:  # noqa: ANN401, a class that rosbags makes at run time
    q, t = transform.rotation, transform.translation
    w, x, y, z = np.array([q.w, q.x, q.y, q.z]) / max(float(np.linalg.norm([q.w, q.x, q.y, q.z])), 1e-12)
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = t.x, t.y, t.z
    return T
