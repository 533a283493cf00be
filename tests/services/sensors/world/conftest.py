"""One small world for all tests of the folder: fewer things, and images of a quarter of the size."""

from __future__ import annotations

import pytest

from common.camera import StereoCamera
from services.sensors.world import SceneSettings, World, WorldSettings
from services.sensors.world.settings import forward_camera

SCENE = SceneSettings(
    seed=3, extent=64.0, trees=14, bushes=6, boxes=8, stones=25, tufts=40, houses=2, walls=3, fences=2
)
RIG = StereoCamera(320, 200, 212.5, 212.5, 159.5, 99.5, 0.24, forward_camera())
SETTINGS = WorldSettings(scene=SCENE, rig=RIG)


@pytest.fixture(scope="session")
def shared_world() -> World:
    return World(SETTINGS)


@pytest.fixture
def world(shared_world: World) -> World:
    shared_world.set_time(SETTINGS.time)
    shared_world.place(*shared_world.scene.demo_route()[0])
    return shared_world
