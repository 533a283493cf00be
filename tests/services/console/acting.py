"""Processes of a robot, acted: what a console hears of a robot that repeats a route, and a map store that answers."""

import itertools
import threading

import numpy as np

from common import geometry, topics
from common.camera import StereoCamera
from common.geometry import Uncertain
from common.ids import VertexId, new_map_id
from common.messages import (
    CameraModel,
    Done,
    Goal,
    Health,
    Localization,
    MapRecord,
    Matches,
    Odometry,
    Percentiles,
    Restriction,
    Route,
    SafetyStatus,
    State,
    StateName,
    StereoFrame,
    StopReason,
    TrackerStatus,
    now_ns,
)
from common.posegraph.graph import Edge, PoseGraph
from common.posegraph.topology import to_topology

ENVIRONMENT = "default"
DAY_NS = 86_400_000_000_000
CAMERA = StereoCamera(320, 200, 212.0, 212.0, 159.5, 99.5, 0.24)


def record(days=0.0, generation=0, parent=None, robot="r1"):
    stamp = now_ns() - round(days * DAY_NS)
    return MapRecord(
        id=new_map_id(robot, stamp), environment=ENVIRONMENT, stamp=stamp, robot=robot, sensor="stereo",
        generation=generation, parent=parent,
    )  # fmt: skip


def loop(vertices, radius=None):
    """Poses (N, 3) along an eight."""
    t = np.linspace(0.0, 2.0 * np.pi * 0.97, vertices)
    size = radius or 0.5 * vertices / 7.0
    x, y = size * np.sin(t), 0.6 * size * np.sin(2.0 * t)
    yaw = np.arctan2(np.gradient(y), np.gradient(x))
    return np.stack([x, y, yaw], axis=1)


def transforms(poses):
    return np.array([geometry.from_xy_yaw(*pose) for pose in poses])


def add_map(graph, about, poses, onto=None, every=4):
    """Adds a map along poses (N, 3); ``onto`` is a map, and its poses, that edges join each ``every``-th vertex to."""
    graph.add_experience(about).finished = True
    T = transforms(poses)
    for index in range(len(poses)):
        graph.add_vertex(VertexId(about.id, index))
        if index:
            step = geometry.inverse(T[index - 1]) @ T[index]
            graph.add_edge(
                Edge(VertexId(about.id, index - 1), VertexId(about.id, index), Uncertain.exactly(step), False)
            )
    if onto is not None:
        other, at = onto
        for index in range(0, min(len(poses), len(at)), every):
            step = geometry.inverse(transforms(at[index : index + 1])[0]) @ T[index]
            graph.add_edge(Edge(VertexId(other, index), VertexId(about.id, index), Uncertain.exactly(step), True))


def network(vertices=200, repeats=2):
    """A taught eight, with repeats of it beside, and two places; the graph, and the taught map's record and poses."""
    graph = PoseGraph(ENVIRONMENT)
    taught, poses = record(days=20.0), loop(vertices)
    add_map(graph, taught, poses)
    for number in range(repeats):
        beside = poses + np.array([0.0, 0.2 * (number + 1), 0.0])
        add_map(graph, record(10.0 / (number + 1), 1, taught.id), beside, (taught.id, poses))
    graph.name_place("home", VertexId(taught.id, 0))
    graph.name_place("gate", VertexId(taught.id, vertices - 1))
    third = vertices // 3
    graph.restrictions.append(Restriction(map=taught.id, first=third, last=third + vertices // 20, speed=0.4))
    return graph, taught, poses


class ActedRobot:
    """Acts as every process but the console, on the bus of a :class:`tests.processes.Robot`."""

    def __init__(self, robot, graph, taught, poses, *, real=(), camera=CAMERA):
        """``real`` are the processes that are not acted, since they run."""
        self.camera = camera
        self.graph, self.taught, self.poses = graph, taught, poses
        self.at = 0
        self.orders = []
        self.lock = threading.Lock()
        navigator, estimator, store = robot.act_as("navigator"), robot.act_as("estimator"), robot.act_as("mapstore")
        tracker, self.sensors = robot.act_as("tracker"), robot.act_as("sensors")
        safety = robot.bus("safety") if "safety" in real else robot.act_as("safety")
        self.real = real
        robot.act_as("planner")
        self.buses = {
            "navigator": navigator,
            "estimator": estimator,
            "mapstore": store,
            "tracker": tracker,
            "safety": safety,
        }
        store.serve(topics.TOPOLOGY, lambda _question: self._topology())
        store.serve(topics.NAME_PLACE, self._name)
        navigator.serve(topics.MISSION, self._order)
        if "safety" not in real:
            safety.serve(topics.SAFETY_COMMAND, self._safety_command)
        self._state, self._route = navigator.publisher(topics.STATE), navigator.publisher(topics.ROUTE)
        self._odometry, self._located = estimator.publisher(topics.ODOMETRY), estimator.publisher(topics.LOCALIZATION)
        self._matches = estimator.publisher(topics.MATCHES)
        self._tracked, self._safety = tracker.publisher(topics.TRACKER_STATUS), safety.publisher(topics.SAFETY_STATUS)
        self._frames = self.sensors.publisher(topics.STEREO, "front")
        self._health = {
            name: bus.publisher(topics.HEALTH, name) for name, bus in self.buses.items() if name not in real
        }
        self._ticks = itertools.count()
        self._image = np.random.default_rng(1).integers(0, 255, (camera.height, camera.width, 3), dtype=np.uint8)
        self.latched = False
        self.stops = []
        self.state = State(
            stamp=now_ns(), name=StateName.REPEAT_FOLLOW, environment=ENVIRONMENT, since=now_ns(), route="route1",
            reason=f"localized against {taught.id}:0", goal="gate", goals=[Goal(to="home"), Goal(to=f"{taught.id}:5")],
        )  # fmt: skip

    def publish_route(self):
        count = len(self.poses)
        self._route.put(
            Route(
                id="route1", environment=ENVIRONMENT, goal="gate", path=transforms(self.poses), length=0.15 * count,
                vertices=[VertexId(self.taught.id, index) for index in range(count)], maps=[self.taught.id],
                reason="the shortest way", why=["the only map"],
            )
        )  # fmt: skip

    def tick(self, *, frames=False):
        """A tenth of a second of everything."""
        number, stamp = next(self._ticks), now_ns()
        self.at = number % len(self.poses)
        trunk, small = VertexId(self.taught.id, self.at), 1e-4 * np.eye(6)
        offset = 0.05 * np.sin(number / 9.0)
        T = geometry.from_xy_yaw(0.05, offset, 0.02)
        twist = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.1])
        self._state.put(self.state.model_copy(update={"stamp": stamp}))
        self._odometry.put(
            Odometry(
                stamp=stamp, vertex=trunk, T_vertex_robot=T, covariance=small, twist=twist, success=True, inliers=180
            )
        )  # fmt: skip
        if self.state.route:
            self._located.put(
                Localization(
                    stamp=stamp, route="route1", trunk=trunk, trunk_index=self.at, T_trunk_robot=T, covariance=small,
                    success=True, stream="plain", streams={"plain": True, "invariant": number % 20 < 15},
                    inliers=150 + number % 40, metres_since_success=0.0, seconds_since_success=0.0,
                )
            )  # fmt: skip
            self._tracked.put(
                TrackerStatus(
                    stamp=stamp, route="route1", lateral_error=offset, heading_error=0.02, arclength=0.15 * self.at,
                    remaining=0.15 * (len(self.poses) - self.at), speed_limit=1.2, finished=False,
                )
            )  # fmt: skip
        if "safety" not in self.real:
            self._guard(stamp)
        if frames:
            self._see(stamp)
        if number % 10 == 0:
            for name, publisher in self._health.items():
                publisher.put(_health(name, stamp))

    def _guard(self, stamp):
        reasons = [StopReason(rule="emergency_stop", text="The emergency stop is latched.")] if self.latched else []
        self._safety.put(
            SafetyStatus(stamp=stamp, passing=not self.latched, scale=1.0, latched=self.latched, reasons=reasons)
        )

    def _see(self, stamp):
        camera = CameraModel.of(self.camera)
        self._frames.put(StereoFrame(stamp=stamp, camera=camera, left=self._image, right=self._image))
        pixels = np.random.default_rng(stamp % 1000).uniform(10, 190, (80, 2)).astype(np.float32)
        self._matches.put(Matches(stamp=stamp, stream="plain", success=True, pixels=pixels))

    def _topology(self):
        with self.lock:
            return to_topology(self.graph)

    def _name(self, wanted):
        with self.lock:
            self.graph.name_place(wanted.place, wanted.vertex)
        return Done()

    def _order(self, command):
        self.orders.append(command)
        return Done(text=f"{command.action}: done")

    def _safety_command(self, command):
        self.stops.append(command)
        self.latched = command.action == "stop"
        return Done(text="the emergency stop is latched" if self.latched else "it is released")


def _health(name, stamp):
    return Health(
        stamp=stamp, process=name, pid=1000, started=stamp - 60_000_000_000, cpu=0.12, memory_mb=180.0,
        rates={"state": 10.0}, dropped={}, stages={"step": Percentiles(count=10, p50=1.0, p99=2.0)},
    )  # fmt: skip
