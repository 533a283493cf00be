"""Every topic: its key, message, owner, rate, maximum age, priority, congestion control, and what a late joiner gets.

"Alive", "at its rate" and "fresh" follow from this table, and so do the page of messages in the docs and the columns
of ``vtr ps``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

from common import messages as m
from common.ids import NAME_PATTERN

SCHEMA = 1
"""Version of the messages: a receiver drops samples of another one."""


FLEET = "fleet"
"""Stands in keys where a robot's name stands else; so no robot may have it."""


class Delivery(Enum):
    """How samples reach a subscriber.

    FRAME: only the newest counts; a late joiner waits for the next. STATE: in order, and a late joiner gets the
    last one at once. QUERY: a question with an answer.
    """

    FRAME = "frame"
    STATE = "state"
    QUERY = "query"


class Priority(Enum):
    """Zenoh's priorities that are used, most urgent first."""

    REAL_TIME = "real time"
    HIGH = "high"
    DATA = "data"
    BACKGROUND = "background"


@dataclass(frozen=True, slots=True)
class Topic:
    """One row of the table.

    Attributes:
        key: key expression below ``vtr/<robot>/``; ``{name}`` stands for a sensor's or a service's name.
        message: its payload, or the question of a query.
        owners: processes that may publish it, or that answer the query; anybody else's samples are dropped.
        delivery: see :class:`Delivery`.
        answer: the answer of a query.
        rate_hz: expected rate, 0 where it comes only on events.
        max_age_s: older than this since its arrival, it is stale.
        priority: see :class:`Priority`.
        blocking: whether a publisher waits for room rather than drop, as states must.
        fleet: whether it belongs to the fleet's server: then its key is below ``vtr/fleet/``, ``{name}`` stands for an
            environment's name, and any robot may ask.
        askers: processes that may ask a query which changes something; anybody may, where it changes nothing.
    """

    key: str
    message: type[m.Message]
    owners: tuple[str, ...]
    delivery: Delivery
    answer: type[m.Message] | None = None
    rate_hz: float = 0.0
    max_age_s: float = float("inf")
    priority: Priority = Priority.DATA
    blocking: bool = False
    fleet: bool = False
    askers: tuple[str, ...] = ("*",)

    def at(self, robot: str, name: str = "") -> str:
        """The whole key of this topic on a robot, for one sensor or service where the key asks for a name."""
        return f"vtr/{FLEET if self.fleet else robot}/{self.key.format(name=name)}"


_PERSON = ("operator", "console")
"""Processes that carry a person's orders."""

_FRAME, _STATE, _QUERY = Delivery.FRAME, Delivery.STATE, Delivery.QUERY

STEREO = Topic("sensor/stereo/{name}", m.StereoFrame, ("sensors", "player"), _FRAME, rate_hz=10, max_age_s=0.5)
CAMERA = Topic("sensor/camera/{name}", m.CameraFrame, ("sensors", "player"), _FRAME, rate_hz=10, max_age_s=0.5)
LIDAR = Topic("sensor/lidar/{name}", m.LidarScan, ("sensors", "player"), _FRAME, rate_hz=10, max_age_s=0.5)
WHEEL_ODOMETRY = Topic(
    "sensor/odometry", m.WheelOdometry, ("sensors", "base", "player"), _FRAME, rate_hz=50, max_age_s=0.2
)
JOYSTICK = Topic(
    "sensor/joystick", m.Joystick, ("sensors", "console", "operator", "player"), _FRAME, rate_hz=20, max_age_s=0.3
)

ODOMETRY = Topic("odometry", m.Odometry, ("estimator",), _FRAME, rate_hz=10, max_age_s=0.5, priority=Priority.HIGH)
LOCALIZATION = Topic(
    "localization", m.Localization, ("estimator",), _FRAME, rate_hz=10, max_age_s=0.5, priority=Priority.HIGH
)
MATCHES = Topic(
    "localization/matches", m.Matches, ("estimator",), _FRAME, rate_hz=10, max_age_s=0.5, priority=Priority.BACKGROUND
)
LOOP_CLOSURE = Topic("loop_closure", m.LoopClosure, ("estimator",), _STATE, blocking=True)

RELOCALIZE = Topic(
    "relocalize", m.Relocalize, ("estimator",), _QUERY, answer=m.Relocalization, askers=("navigator", *_PERSON)
)

COMMIT = Topic("graph/commit", m.Commit, ("mapstore",), _QUERY, answer=m.Done, askers=("estimator", "navigator"))
MAPS = Topic("graph/maps", m.GraphQuery, ("mapstore",), _QUERY, answer=m.MapList)
TOPOLOGY = Topic("graph/topology", m.GraphQuery, ("mapstore",), _QUERY, answer=m.Topology)
SUBMAP = Topic("graph/submap", m.GraphQuery, ("mapstore",), _QUERY, answer=m.Submap)
APPEARANCE = Topic("graph/appearance", m.AppearanceQuery, ("mapstore",), _QUERY, answer=m.Appearances)
REMOVE = Topic("graph/remove", m.GraphQuery, ("mapstore",), _QUERY, answer=m.Done, askers=_PERSON)
NAME_PLACE = Topic("graph/place", m.NamePlace, ("mapstore",), _QUERY, answer=m.Done, askers=("navigator", *_PERSON))
RESTRICT = Topic("graph/restrict", m.Restriction, ("mapstore",), _QUERY, answer=m.Done, askers=("navigator",))
ENDS = Topic("graph/ends", m.MapEnds, ("mapstore",), _QUERY, answer=m.Done, askers=("navigator",))

FETCH = Topic("sync/fetch", m.FetchRequest, ("mapstore",), _QUERY, answer=m.Done, askers=("planner", *_PERSON))
PUSH = Topic("sync/push", m.PushRequest, ("mapstore",), _QUERY, answer=m.Done, askers=_PERSON)
REPORT = Topic("sync/report", m.RepeatReport, ("mapstore",), _QUERY, answer=m.Done, askers=("navigator",))
SYNC_STATUS = Topic("sync/status", m.SyncStatus, ("mapstore",), _STATE, priority=Priority.BACKGROUND, blocking=True)

PLAN = Topic("plan", m.PlanRequest, ("planner",), _QUERY, answer=m.Route)
ROUTE = Topic("route", m.Route, ("navigator",), _STATE, blocking=True)
MISSION = Topic("mission/command", m.Command, ("navigator",), _QUERY, answer=m.Done, askers=_PERSON)
STATE = Topic(
    "state", m.State, ("navigator",), _STATE, rate_hz=10, max_age_s=0.35, priority=Priority.HIGH, blocking=True
)

DESIRED = Topic(
    "command/desired", m.VelocityCommand, ("tracker",), _FRAME, rate_hz=20, max_age_s=0.25, priority=Priority.REAL_TIME
)
TELEOP = Topic(
    "command/teleop", m.VelocityCommand, ("operator", "console", "sensors"), _FRAME, rate_hz=20, max_age_s=0.25,
    priority=Priority.REAL_TIME,
)  # fmt: skip
SAFE = Topic(
    "command/safe", m.VelocityCommand, ("safety",), _FRAME, rate_hz=50, max_age_s=0.3, priority=Priority.REAL_TIME
)
TRACKER_STATUS = Topic("tracker/status", m.TrackerStatus, ("tracker",), _FRAME, rate_hz=10, max_age_s=0.5)
OBSTACLES = Topic("obstacles", m.Obstacles, ("obstacles",), _FRAME, rate_hz=10, max_age_s=0.5, priority=Priority.HIGH)
SAFETY_STATUS = Topic("safety/status", m.SafetyStatus, ("safety",), _STATE, rate_hz=10, max_age_s=0.5, blocking=True)
SAFETY_COMMAND = Topic(
    "safety/command", m.SafetyCommand, ("safety",), _QUERY, answer=m.Done, priority=Priority.REAL_TIME, askers=_PERSON
)

HEALTH = Topic("health/{name}", m.Health, ("*",), _FRAME, rate_hz=1, max_age_s=3, priority=Priority.BACKGROUND)

TRUTH = Topic("truth/pose", m.Truth, ("sensors",), _FRAME, rate_hz=50, max_age_s=0.5)
TRUTH_PLACE = Topic("truth/place", m.Place, ("sensors",), _QUERY, answer=m.Done, askers=("operator",))
TRUTH_TIME = Topic("truth/time", m.WorldTime, ("sensors",), _QUERY, answer=m.Done, askers=("operator",))

ALL: tuple[Topic, ...] = tuple(value for value in list(globals().values()) if isinstance(value, Topic))
"""A robot's topics."""

ANNOUNCE = Topic("{name}/announce", m.Announcement, (FLEET,), _QUERY, answer=m.Done, fleet=True, askers=("mapstore",))
MODEL = Topic("{name}/model", m.EnvironmentModel, (FLEET,), _STATE, blocking=True, fleet=True)
CATALOG = Topic("{name}/maps", m.CatalogQuery, (FLEET,), _QUERY, answer=m.Catalog, fleet=True)
FLEET_PLAN = Topic("{name}/plan", m.FleetPlanRequest, (FLEET,), _QUERY, answer=m.FleetPlan, fleet=True)
SIMILARITY = Topic("{name}/similarity", m.SimilarityQuery, (FLEET,), _QUERY, answer=m.Similarities, fleet=True)
SPECTRUM = Topic("{name}/spectrum", m.SpectrumQuery, (FLEET,), _QUERY, answer=m.EnvironmentSpectrum, fleet=True)
ENVIRONMENTS = Topic("environments", m.FleetQuery, (FLEET,), _QUERY, answer=m.FleetEnvironments, fleet=True)

REBUILD = Topic("rebuild", m.FleetQuery, (FLEET,), _QUERY, answer=m.Done, fleet=True, askers=("operator",))

OF_THE_FLEET: tuple[Topic, ...] = (ANNOUNCE, MODEL, CATALOG, FLEET_PLAN, SIMILARITY, SPECTRUM, ENVIRONMENTS, REBUILD)
"""The server's topics."""


def find(key: str) -> tuple[Topic, str] | None:
    """The topic that is published under a key below ``vtr/<robot>/``, and the name in the key; None where none is."""
    for topic in ALL:
        before, brace, _ = topic.key.partition("{")
        if topic.delivery is not Delivery.QUERY and (key == topic.key or (brace and key.startswith(before))):
            name = key.removeprefix(before) if brace else ""
            if not brace or re.fullmatch(NAME_PATTERN, name):
                return topic, name
    return None
