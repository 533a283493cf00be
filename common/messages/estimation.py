"""Where the estimator says that the robot is."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from common.arrays import Actions, Covariance, Pixels, Transform, Twist
from common.ids import VertexId
from common.messages.base import Count, Message, Name, NotNegative, Stamp, Text


class Odometry(Message):
    """Pose of the robot in the last vertex (or in the first frame, where there is no vertex yet).

    ``twist`` (6,) is in the vehicle frame; ``success`` is False where the motion is only predicted. ``wheels`` is the
    stamp of the wheels' report that the frame was taken with, None where none was fresh: a replay takes the same.
    """

    stamp: Stamp
    vertex: VertexId | None
    T_vertex_robot: Transform
    covariance: Covariance
    twist: Twist
    success: bool
    inliers: Count
    reason: Text = ""
    wheels: Stamp | None = None


class Localization(Message):
    """The localization chain's state after a frame.

    ``trunk`` is the route's vertex that the robot is nearest to and ``trunk_index`` its place in the route.
    ``T_trunk_robot`` is by localization where ``success``, else dead reckoning from the last one. ``streams`` says of
    each stream whether it localized; ``stream`` is the one that the estimate was taken from.

    Where not ``metric``, distance along the way and heading alone are measured: x of ``T_trunk_robot`` is the distance
    from the trunk, its yaw the heading, and y says nothing. ``actions`` (K, 3), in order, are what was taught around
    the robot, to be replayed: ``[metres ahead of the robot, m/s, rad/s]``.
    """

    stamp: Stamp
    route: Text
    trunk: VertexId
    trunk_index: Count
    T_trunk_robot: Transform
    covariance: Covariance
    success: bool
    stream: Name
    streams: Annotated[dict[Name, bool], Field(max_length=8)] = {}
    inliers: Count
    metres_since_success: NotNegative
    seconds_since_success: NotNegative
    reason: Text = ""
    metric: bool = True
    actions: Actions | None = None


class Matches(Message):
    """Where in the left image of a frame, or in a scan, the landmarks are that localized it, for people to look at.

    ``pixels`` (N, 2) are x, y, of a scan column and row, of those that agree on the pose, ``stream`` the images that
    they are of.
    """

    stamp: Stamp
    stream: Name
    success: bool
    pixels: Pixels


class Relocalize(Message):
    """Asks where in an environment the robot stands, of which nothing is known."""

    environment: Name


class Relocalization(Message):
    """Answer to ``relocalize``: the vertex that the robot found itself at, taught if any is near, and its pose there.

    ``stamp`` is that of the frame, ``inliers`` the landmarks that agree, ``stream`` the images that they are of.
    """

    stamp: Stamp
    vertex: VertexId
    T_vertex_robot: Transform
    covariance: Covariance
    inliers: Count
    stream: Name


def covariance_of(variances: tuple[float, ...] | list[float]) -> Covariance:
    """A diagonal covariance (6, 6) of variances in m^2 and rad^2."""
    return np.diag(np.asarray(variances, dtype=np.float64))
