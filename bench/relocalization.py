"""Relocalisation without a prior among 2,000 vertices: its time, beside brute force, and how often it is right.

The demo's route is taught in the synthetic world; 2,000 vertices come of it by copies of each real one whose
descriptors have their bits in another order, so that they are as unevenly spread as real ones and match nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.table import show
from common import geometry
from common.geometry import Array, Uncertain
from common.ids import VertexId, new_map_id
from common.messages import MapRecord, VertexRecord
from common.posegraph import Edge, PoseGraph, from_topology, to_topology
from services.estimator.pipeline import Localized
from services.estimator.relocalization import AppearanceIndex, Found, RelocalizationSettings, Relocalizer, appearance_of
from services.estimator.relocalization import tables as hashing
from services.estimator.stereo.pipeline import StereoPipeline
from services.estimator.stereo.settings import StereoSettings
from services.estimator.stereo.streams import Streams
from services.estimator.stereo.submap import StereoSubmap
from services.sensors.world import World, WorldSettings

VERTICES = 2000
TAUGHT_STEP_M = 0.4
TAUGHT_HOUR = 9
ASKED_HOURS = (9, 10, 12, 16)
ASKED = 40
BESIDE_M, TURNED = 0.3, 0.06
"""Standard deviations of where the robot stands beside the taught path, metres and radians."""

WRONG_M = 0.5
_MATCHED = 200_000
"""Descriptors of one call of OpenCV's matcher, which takes less than 2^18."""

EDGE = np.diag(np.repeat([0.005, 0.002], 3) ** 2)
SETTINGS = RelocalizationSettings()
Looks = dict[str, NDArray[np.uint8]]


@dataclass(frozen=True, slots=True)
class View:
    """A processed frame: what was made of it, what it looks like, and the true pose of the vehicle."""

    live: Streams
    looks: Looks
    T_world_vehicle: Array


class Camera:
    """A robot in a world, put down where it is to see something."""

    def __init__(self, scene_seed: int | None = None) -> None:
        settings = WorldSettings()
        scene = settings.scene if scene_seed is None else replace(settings.scene, seed=scene_seed)
        self.world = World(replace(settings, scene=scene, clouds=0.0))
        self.pipeline = StereoPipeline(self.world.camera, StereoSettings())

    def drive(self, hour: int, count: int, beside: float, turned: float) -> list[View]:
        """Views from ``count`` places along the route, each some way beside it."""
        self.world.set_time(datetime(2026, 6, 21, hour, tzinfo=UTC))
        route, rng = self.world.scene.demo_route(), np.random.default_rng(hour)
        views = []
        for x, y, yaw in route[np.linspace(0, len(route) - 1, count).astype(int)]:
            offset = rng.normal(0.0, beside)
            self.world.place(x - np.sin(yaw) * offset, y + np.cos(yaw) * offset, yaw + rng.normal(0.0, turned))
            views.append(self.see(settle=1 if views else 8))
        return views

    def see(self, settle: int) -> View:
        """The view from here, once the exposure has had ``settle`` half seconds."""
        for _ in range(settle):
            self.world.step(0.5, None)
            left, right = self.world.render()
        # A pipeline of its own: odometry learns from its frames, and these are no drive.
        live = StereoPipeline(self.world.camera, StereoSettings()).process(left, right, 0).live
        looks = appearance_of({name: frame.features for name, frame in live.items()}, SETTINGS.query_descriptors)
        return View(live, looks, self.world.T_world_vehicle)


class Network:
    """A taught route, and copies of it that look like nothing else."""

    def __init__(self, views: Sequence[View], camera: Camera) -> None:
        self.graph = PoseGraph("bench")
        self.index = AppearanceIndex(SETTINGS)
        self.poses: dict[VertexId, Array] = {}
        self.submaps: dict[VertexId, StereoSubmap] = {}
        self.looks: dict[VertexId, Looks] = {}
        self._camera = camera
        rng = np.random.default_rng(0)
        for number in range(-(-VERTICES // len(views))):
            order = np.arange(256) if number == 0 else rng.permutation(256)
            self._add_map(number, views[: VERTICES - len(self.poses)], order)
        self.index.prepare()

    def _add_map(self, number: int, views: Sequence[View], order: NDArray[np.int64]) -> None:
        map_id = new_map_id("r1", (number + 1) * 10**9)
        self.graph.add_experience(MapRecord(id=map_id, environment="bench", stamp=number, robot="r1", sensor="front"))
        for index, view in enumerate(views):
            name = VertexId(map_id, index)
            self.graph.add_vertex(name)
            if index:
                T = geometry.inverse(views[index - 1].T_world_vehicle) @ view.T_world_vehicle
                self.graph.add_edge(Edge(VertexId(map_id, index - 1), name, Uncertain(T, EDGE), spatial=False))
            self._add_vertex(name, view, order, is_real=number == 0)

    def _add_vertex(self, name: VertexId, view: View, order: NDArray[np.int64], *, is_real: bool) -> None:
        keyframe = self._camera.pipeline.keyframe(view.live)
        arrays = {k: shuffled(a, order) if k.endswith("/descriptors") else a for k, a in keyframe.arrays.items()}
        record = VertexRecord(id=name, stamp=0, keyframe=keyframe.model_copy(update={"arrays": arrays}))
        submap = self._camera.pipeline.read(record)
        self.submaps[name] = submap
        self.looks[name] = appearance_of(submap.streams)
        # A copy is nowhere: whoever is found there is wrong.
        self.poses[name] = view.T_world_vehicle if is_real else np.full((4, 4), np.nan)
        self.index.add(name, self.looks[name])

    def relocalizer(self, pipeline: StereoPipeline) -> Relocalizer[Streams, StereoSubmap]:
        """One that has every submap at hand."""
        return Relocalizer(
            self.index, self.graph, pipeline.search, lambda vertices: {v: self.submaps[v] for v in vertices}, SETTINGS
        )

    def error(self, found: Found, view: View) -> float:
        """Metres between where the robot is found and where it stands; infinite in a copy."""
        error = geometry.inverse(self.poses[found.vertex] @ found.T_vertex_live.T) @ view.T_world_vehicle
        metres = float(np.linalg.norm(error[:3, 3]))
        return metres if np.isfinite(metres) else np.inf


def shuffled(descriptors: NDArray[np.uint8], order: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Descriptors (N, 32) with their bits in another order."""
    return np.packbits(np.unpackbits(descriptors, axis=1)[:, order], axis=1)


def milliseconds(work: Callable[[View], object], views: Sequence[View]) -> tuple[float, float]:
    """Median and longest CPU time of a call."""
    spent = []
    for view in views:
        begin = time.process_time()
        work(view)
        spent.append(1e3 * (time.process_time() - begin))
    return float(np.median(spent)), max(spent)


def brute_force(network: Network) -> Callable[[View], object]:
    """OpenCV's matcher over all descriptors of both streams: the nearest of every query."""
    every = {s: np.concatenate([looks[s] for looks in network.looks.values()]) for s in ("plain", "invariant")}
    parts = {s: np.array_split(descriptors, -(-len(descriptors) // _MATCHED)) for s, descriptors in every.items()}
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    return lambda view: [matcher.match(looks, part) for s, looks in view.looks.items() for part in parts[s]]


def times(network: Network, views: Sequence[View], pipeline: StereoPipeline) -> list[list[object]]:
    """How long the parts take."""
    searched: list[float] = []

    def search(submap: StereoSubmap, live: Streams) -> Localized:
        begin = time.process_time()
        result = pipeline.search(submap, live)
        searched.append(1e3 * (time.process_time() - begin))
        return result

    vertices = list(network.submaps)
    relocalizer = Relocalizer(
        network.index, network.graph, search, lambda some: {v: network.submaps[v] for v in some}, SETTINGS
    )
    topology = to_topology(network.graph)
    rows: list[list[object]] = [
        ["retrieval by the index", *milliseconds(lambda view: network.index.rank(view.looks), views)],
        ["retrieval by brute force (OpenCV), no votes", *milliseconds(brute_force(network), views[:10])],
        ["retrieval and verification", *milliseconds(lambda view: relocalizer.find(view.live, view.looks), views)],
    ]
    rows.append(["of this, one search in a submap", float(np.median(searched)), max(searched)])
    rows.append(["reading the topology of the graph", *milliseconds(lambda _: from_topology(topology), views[:5])])
    rows.append(
        [f"building the tables of {len(vertices)} vertices", *milliseconds(lambda _: _rebuild(network), views[:3])]
    )
    return rows


def _rebuild(network: Network) -> None:
    for stream in ("plain", "invariant"):
        found = [looks[stream] for looks in network.looks.values()]
        owners = np.repeat(np.arange(len(found), dtype=np.int32), [len(f) for f in found])
        hashing.build(np.concatenate(found), owners, np.zeros(len(found), np.int32))


def recall(name: str, network: Network, views: Sequence[View], pipeline: StereoPipeline) -> list[object]:
    """How often the place is the first, among the candidates, found, and wrong."""
    relocalizer = network.relocalizer(pipeline)
    first = among = found = wrong = 0
    errors = []
    for view in views:
        near = {v for v, T in network.poses.items() if np.linalg.norm(T[:2, 3] - view.T_world_vehicle[:2, 3]) < 1.5}
        chosen = [c.vertex for c in relocalizer._candidates(view.looks)]  # noqa: SLF001, what is measured
        first += bool(chosen) and chosen[0] in near
        among += not near.isdisjoint(chosen)
        result = relocalizer.find(view.live, view.looks)
        if isinstance(result, Found):
            found += 1
            errors.append(network.error(result, view))
            wrong += errors[-1] > WRONG_M
    parts = [f"{100 * count / len(views):.0f} %" for count in (first, among, found)]
    return [name, *parts, wrong, float(np.median(errors)) if errors else "-"]


def main() -> None:
    """Prints the tables."""
    camera = Camera()
    length = len(camera.world.scene.demo_route()) / 10
    network = Network(camera.drive(TAUGHT_HOUR, round(length / TAUGHT_STEP_M), 0.0, 0.0), camera)
    asked = {hour: camera.drive(hour, ASKED, BESIDE_M, TURNED) for hour in ASKED_HOURS}
    network.index.rank(asked[TAUGHT_HOUR][0].looks)
    network.relocalizer(camera.pipeline).find(asked[TAUGHT_HOUR][0].live, asked[TAUGHT_HOUR][0].looks)
    show(
        f"Relocalisation among {len(network.index)} vertices, CPU ms",
        ["what", "median", "most"],
        times(network, asked[TAUGHT_HOUR], camera.pipeline),
    )
    rows = [recall(f"{hour:02d}:00", network, views, camera.pipeline) for hour, views in asked.items()]
    elsewhere = Camera(scene_seed=13)
    rows.append(recall("another world", network, elsewhere.drive(10, ASKED, 0.0, 0.0), elsewhere.pipeline))
    show(
        f"Taught at {TAUGHT_HOUR:02d}:00, asked at other times",
        ["asked at", "first", f"among {SETTINGS.candidates}", "found", "wrong", "median error m"],
        rows,
        note=f"{ASKED} frames each, {BESIDE_M} m and {np.degrees(TURNED):.0f} degrees beside the path (standard "
        f"deviations); wrong is more than {WRONG_M} m away, or in another place",
    )


if __name__ == "__main__":
    main()
