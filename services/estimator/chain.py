"""The localization chain: trunk, branch, twig and leaf (VT&R3 overview, *Localization Chain*).

```
privileged path   ... ── branch ── ... ── trunk ── ...
                            │
live path                  twig ── ... ── leaf
```

* trunk: the privileged vertex nearest to the robot;
* branch: the privileged vertex last localized against;
* twig: the live frame that was localized there;
* leaf: the newest live frame.

Every frame is the vehicle's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from common import geometry
from common.geometry import Array, Uncertain
from services.estimator.pipeline import Step
from services.estimator.reckoning import DeadReckoning


@dataclass(frozen=True, slots=True)
class ChainSettings:
    """How the trunk moves on.

    Attributes:
        look_ahead, look_back: how far along the path the nearest vertex is sought from the present trunk, metres, and
            at least a few vertices far. A route that crosses itself is longer than that between its crossings.
        rotation_weight: metres that a radian of rotation counts for when distances to vertices are compared.
        path_drift: standard deviation of the path between branch and trunk, metres (and half as many radians) a
            metre; the route carries no covariance.
        floor: standard deviation (m, and half as many radians) that no prior falls below, for what no model knows.
    """

    look_ahead: float = 3.0
    look_back: float = 1.5
    rotation_weight: float = 0.5
    path_drift: float = 0.02
    floor: float = 0.01


class LocalizationChain:
    """Where the live robot is on a route of N privileged vertices.

    Built from the vertices' poses ``T_first_vertex`` (N, 4, 4) in the first one's frame. Only poses of vertices near
    each other are ever compared, so the path need not be globally consistent.
    """

    def __init__(self, path: Array, settings: ChainSettings | None = None) -> None:
        self._settings = settings or ChainSettings()
        self._path: Array
        self._arclength: Array
        self.extend(path)
        self.trunk = 0
        self.branch = 0
        self._T_branch_leaf = DeadReckoning()
        self._metres = 0.0
        self.localized = False

    def extend(self, path: Array) -> None:
        """Goes on over a longer route, whose first vertices are those of the present one: nothing is forgotten."""
        self._path = np.asarray(path, dtype=np.float64)
        self._arclength = geometry.arclength(self._path)
        longest = float(np.diff(self._arclength).max(initial=0.0))
        self._look_back = max(self._settings.look_back, 1.5 * longest)
        self._look_ahead = max(self._settings.look_ahead, 3.0 * longest)

    def metres_left(self) -> float:
        """From the trunk to the route's end."""
        return float(self._arclength[-1] - self._arclength[self.trunk])

    def T_end_leaf(self) -> Uncertain:
        """The leaf in the frame of the route's last vertex, by the path; near the end alone is this of use."""
        T_end_trunk = geometry.inverse(self._path[-1]) @ self._path[self.trunk]
        sigma = self._settings.floor + self._settings.path_drift * self.metres_left()
        covariance = np.diag(np.repeat([sigma, sigma / 2.0], 3) ** 2)
        return Uncertain(T_end_trunk, covariance) @ self.T_trunk_leaf()

    def __len__(self) -> int:
        return len(self._path)

    @property
    def metres_since_success(self) -> float:
        """Metres driven since the twig, on dead reckoning."""
        return self._metres

    def start(self, index: int) -> None:
        """Places the robot at a vertex, unlocalized: what :meth:`T_trunk_leaf` says is only an assumption."""
        self.trunk = self.branch = index
        self._T_branch_leaf.start()
        self._metres = 0.0
        self.localized = False

    def move(self, step: Step[Any]) -> None:
        """Takes a frame's odometry, which makes it the leaf, and moves the trunk on."""
        self._T_branch_leaf.move(step)
        self._metres += float(np.linalg.norm(step.T_last_live.T[:3, 3]))
        self._move_trunk()

    def T_trunk_leaf(self) -> Uncertain:
        """The prior of the leaf in the trunk's frame: the path, the last localization, and odometry since."""
        T_trunk_branch = geometry.inverse(self._path[self.trunk]) @ self._path[self.branch]
        metres = abs(self._arclength[self.trunk] - self._arclength[self.branch])
        sigma = self._settings.floor + self._settings.path_drift * metres
        covariance = np.diag(np.repeat([sigma, sigma / 2.0], 3) ** 2)
        return Uncertain(T_trunk_branch, covariance) @ self.T_branch_leaf()

    def T_branch_leaf(self) -> Uncertain:
        """The leaf in the frame of the vertex last localized against."""
        return self._T_branch_leaf.T_reference_live

    def localize(self, T_trunk_leaf: Uncertain) -> None:
        """Takes a successful localization of the leaf: the trunk becomes the branch and the leaf the twig."""
        self.branch = self.trunk
        self._T_branch_leaf.start(T_trunk_leaf)
        self._metres = 0.0
        self.localized = True
        self._move_trunk()

    def window(self, behind: float, ahead: float) -> range:
        """Indices of the vertices from ``behind`` metres before the trunk to ``ahead`` metres after it."""
        here = self._arclength[self.trunk]
        first = int(np.searchsorted(self._arclength, here - behind))
        last = int(np.searchsorted(self._arclength, here + ahead, side="right"))
        return range(first, max(last, first + 1))

    def _move_trunk(self) -> None:
        """Makes the nearest vertex around the present trunk the trunk."""
        around = self.window(self._look_back, self._look_ahead)
        T_branch_vertices = geometry.inverse(self._path[self.branch]) @ self._path[around.start : around.stop]
        T_vertices_leaf = geometry.inverse(T_branch_vertices) @ self.T_branch_leaf().T
        distance = np.linalg.norm(T_vertices_leaf[:, :3, 3], axis=1)
        distance = distance + self._settings.rotation_weight * geometry.rotation_angle(T_vertices_leaf)
        self.trunk = around.start + int(np.argmin(distance))
