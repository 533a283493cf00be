"""A forest to drive through: trunks of known places, drawn as bars, so that images have parallax and cost nothing."""

import numpy as np

from common import geometry
from common.geometry import Uncertain, from_xy_yaw
from common.ids import VertexId, new_map_id
from common.messages import CameraFrame, MapRecord
from services.estimator.bearing import BearingPipeline, BearingRouteLocalizer, BearingSettings
from services.estimator.bearing.comparison import Comparison
from services.estimator.chain import ChainSettings
from services.estimator.experience import ExperienceRecorder
from services.estimator.experiences import ExperienceSettings
from services.estimator.route_localizer import WindowSettings
from services.estimator.route_map import RouteMap

MAP = new_map_id("r1", 0)
STEP_M = 0.1
WHEELS = np.diag([0.005, 0.003, 0.003, 0.01, 0.01, 0.003]) ** 2
SETTINGS = BearingSettings()
COMPARISON = Comparison(SETTINGS)
FRAME_NS = 100_000_000


class Forest:
    """Trunks around the origin; ``field_of_view`` is the camera's own, which the pipeline is not told."""

    def __init__(self, seed=0, trees=160, field_of_view=1.29):
        rng = np.random.default_rng(seed)
        self._places = rng.uniform(-30.0, 30.0, (trees, 2))
        self._bright = rng.uniform(20, 220, trees)
        self._girth = rng.uniform(0.1, 0.5, trees)
        self._height = rng.uniform(1.0, 6.0, trees)
        self._tangent = np.tan(field_of_view / 2.0)
        self._noise = np.random.default_rng(seed + 1)

    def image(self, x, y, yaw, *, width=160, height=96, light=1.0):
        """Grey (H, W), uint8, as seen from a pose of the plane; trunks nearer than 3 m are felled."""
        focal = width / 2.0 / self._tangent
        offset = self._places - [x, y]
        ahead = offset @ [np.cos(yaw), np.sin(yaw)]
        left = offset @ [-np.sin(yaw), np.cos(yaw)]
        picture = np.full((height, width), 240.0)
        picture[height // 2 :] = 110.0
        for k in np.argsort(-ahead):
            if ahead[k] < 3.0 or abs(left[k]) > 1.5 * ahead[k]:
                continue
            scale = focal / ahead[k]
            middle = width / 2.0 - left[k] * scale
            edges = np.rint([middle - self._girth[k] * scale, middle + self._girth[k] * scale]).astype(int)
            top, foot = np.rint([height / 2 - self._height[k] * scale, height / 2 + 0.8 * scale]).astype(int)
            picture[max(top, 0) : max(foot, 0), max(edges[0], 0) : max(edges[1] + 1, 0)] = self._bright[k]
        noisy = light * picture + self._noise.normal(0.0, 2.0, picture.shape)
        return np.clip(noisy, 0, 255).astype(np.uint8)


def curve(metres):
    """A gentle S (N, 3) of x, y, yaw, a pose every :data:`STEP_M`."""
    s = np.arange(0.0, metres + 1e-9, STEP_M)
    yaw = 0.5 * np.sin(s / 5.0)
    x = np.concatenate([[0.0], np.cumsum(np.cos(yaw[:-1]) * STEP_M)])
    y = np.concatenate([[0.0], np.cumsum(np.sin(yaw[:-1]) * STEP_M)])
    return np.stack([x, y, yaw], axis=1)


def pipeline(settings=SETTINGS):
    """A pipeline of its own."""
    return BearingPipeline(settings, COMPARISON if settings is SETTINGS else Comparison(settings))


def steps(through, images, poses, first=0):
    """The steps of a drive over poses (N, 3) with one image each; wheels tell the motion, but not to the first one."""
    last = None
    for k, (image, pose) in enumerate(zip(images, poses, strict=True), start=first):
        T = from_xy_yaw(*pose)
        prior = None if last is None else Uncertain(geometry.inverse(last) @ T, WHEELS)
        last = T
        yield through.take(CameraFrame(stamp=k * FRAME_NS, image=image), prior)


def teach(forest, poses, command=(1.0, 0.0)):
    """Vertices and their poses (N, 4, 4) of a drive that is commanded all the time."""
    through = pipeline()
    recorder = ExperienceRecorder(MapRecord(id=MAP, environment="wood", stamp=0, robot="r1", sensor="bearing"), through)
    images = (forest.image(*pose) for pose in poses)
    vertices, path = [], [np.eye(4)]
    through.obey(*command, 0.0)
    for step in steps(through, images, poses):
        commit = recorder.step(step)
        through.obey(*command, 0.0)
        if commit is not None:
            vertices.append(commit.vertex)
            path.extend(path[-1] @ edge.T_a_b for edge in commit.edges)
    return vertices, np.array(path)


def localizer(vertices, path, through, missing=()):
    """A localizer on a taught map, without the submaps of the ``missing`` vertices."""
    submaps = {vertex.id: through.read(vertex) for vertex in vertices if vertex.id.index not in missing}
    ids = [VertexId(MAP, k) for k in range(len(vertices))]
    route_map = RouteMap(ids, path, through, submaps.get, ExperienceSettings())
    found = BearingRouteLocalizer(
        route_map, path, through, ChainSettings(), WindowSettings(), SETTINGS, COMPARISON, seed=1
    )
    found.start(None)
    return found
