"""The processes around a navigator, played by sessions that can be told what to say."""

import threading

import numpy as np

from common import topics
from common.errors import Refused, Unavailable
from common.geometry import from_xy_yaw
from common.ids import VertexId, new_map_id
from common.messages import (
    Done,
    Localization,
    MapList,
    MapRecord,
    MapSummary,
    Odometry,
    Relocalization,
    Route,
    SafetyStatus,
    StateName,
    TrackerStatus,
    now_ns,
)
from tests.commands import command
from tests.processes import Robot, eventually

OLD = MapRecord(id=new_map_id("r1", 0), environment="default", stamp=0, robot="r1", sensor="stereo")
START, END = VertexId(OLD.id, 0), VertexId(OLD.id, 9)
S = StateName


class Crew:
    """The processes around the navigator: a store, a planner and an estimator that can be told what to say."""

    def __init__(self, robot: Robot):
        self.robot = robot
        self.maps: list[MapSummary] = []
        self.places: dict[str, VertexId] = {}
        self.ends: dict[str, tuple[str | None, str | None]] = {}
        self.reports = []
        self.longer: Route | None = None
        self.fetching = ""
        self.plans = 0
        self.planner_works = threading.Event()
        self.planner_works.set()
        buses = {name: robot.act_as(name) for name in ("sensors", "safety", "mapstore", "planner")}
        self.safety = buses["safety"].publisher(topics.SAFETY_STATUS)
        buses["mapstore"].serve(topics.MAPS, lambda _: MapList(maps=self.maps))
        buses["mapstore"].serve(topics.NAME_PLACE, self.name)
        buses["mapstore"].serve(topics.ENDS, self.tell_ends)
        buses["mapstore"].serve(topics.REPORT, self.report)
        buses["planner"].serve(topics.PLAN, self.plan)
        self.estimator = robot.bus("estimator")
        self.found: VertexId | None = None
        self.estimator.serve(topics.RELOCALIZE, self.relocalize)
        self.localizations = self.estimator.publisher(topics.LOCALIZATION)
        self.odometry = self.estimator.publisher(topics.ODOMETRY)
        self.status = robot.bus("tracker").publisher(topics.TRACKER_STATUS)
        self.operator = robot.bus("operator")
        self.states = self.operator.subscribe(topics.STATE)

    def name(self, question):
        self.places[question.place] = question.vertex
        return Done()

    def tell_ends(self, question):
        self.ends[question.map] = question.start_place, question.end_place
        return Done()

    def report(self, question):
        self.reports.append(question)
        return Done()

    def relocalize(self, question):
        assert question.environment == "default"
        if self.found is None:
            raise Refused("two places look alike")
        return Relocalization(
            stamp=now_ns(), vertex=self.found, T_vertex_robot=np.eye(4), covariance=np.eye(6), inliers=87,
            stream="plain",
        )  # fmt: skip

    def plan(self, question):
        self.planner_works.wait()
        if question.goal == "moon":
            raise Refused("there is no place 'moon'; the places are: end")
        if self.fetching:
            raise Unavailable(self.fetching)
        if question.plan and self.longer is not None:
            return self.longer
        return self.plan_of(question)

    def plan_of(self, question):
        self.plans += 1
        return Route(
            id=f"route{self.plans}",
            environment=question.environment,
            goal=question.goal,
            vertices=[START, END],
            path=np.stack([from_xy_yaw(0, 0, 0), from_xy_yaw(5, 0, 0)]),
            length=5.0,
            maps=[OLD.id],
            reason="the only map",
        )

    def store(self, record, *, finished):
        self.maps = [MapSummary(record=record, vertices=10, length=5.0, bytes=1, finished=finished)]

    def ask(self, action, **rest):
        return self.operator.ask(topics.MISSION, command(action, **rest), timeout=10.0).text

    def state(self):
        received = self.states.last()
        return None if received is None else received.message

    def until(self, name):
        def reached():
            state = self.state()
            return state if state is not None and state.name is name else None

        return eventually(reached, f"the state is {name}, and not {self.state()}")

    def localize(self, route, trunk=START):
        self.localizations.put(
            Localization(
                stamp=now_ns(), route=route, trunk=trunk, trunk_index=0, T_trunk_robot=np.eye(4), covariance=np.eye(6),
                success=True, stream="plain", inliers=100, metres_since_success=0, seconds_since_success=0,
            )
        )  # fmt: skip

    def move(self, vertex):
        self.odometry.put(
            Odometry(
                stamp=now_ns(), vertex=vertex, T_vertex_robot=np.eye(4), covariance=np.eye(6), twist=np.zeros(6),
                success=True, inliers=100,
            )
        )  # fmt: skip

    def latch(self, *, latched):
        self.safety.put(SafetyStatus(stamp=now_ns(), passing=False, scale=0, latched=latched, reasons=[]))

    def track(self, route, *, finished=False):
        self.status.put(
            TrackerStatus(
                stamp=now_ns(), route=route, lateral_error=0, heading_error=0, arclength=0, remaining=0, speed_limit=1,
                finished=finished,
            )
        )  # fmt: skip
