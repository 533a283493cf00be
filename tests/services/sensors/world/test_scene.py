from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from services.sensors.world import Scene, SceneSettings
from services.sensors.world.route import curvature
from tests.services.sensors.world.conftest import SCENE


def test_equal_seeds_give_equal_scenes_and_others_do_not(world):
    again = Scene.build(SCENE)
    assert np.array_equal(again.textures.texels, world.scene.textures.texels)
    assert all(np.array_equal(a.corners, b.corners) for a, b in zip(again.groups, world.scene.groups, strict=True))
    other = Scene.build(replace(SCENE, seed=4))
    assert not np.array_equal(other.textures.texels, again.textures.texels)


def test_the_route_bends_both_ways_and_never_sharply(world):
    route = world.scene.demo_route()
    length = np.linalg.norm(np.diff(route[:, :2], axis=0), axis=-1).sum()
    assert length == pytest.approx(72.0, abs=0.5)
    bend = curvature(route)[5:-5]
    assert bend.max() > 0.05
    assert bend.min() < -0.05
    assert np.abs(bend).max() < 1.0 / 4.0
    heading = np.diff(route[:, :2], axis=0) / np.linalg.norm(np.diff(route[:, :2], axis=0), axis=-1, keepdims=True)
    assert np.abs(heading - np.stack([np.cos(route[:-1, 2]), np.sin(route[:-1, 2])], -1)).max() < 0.03


@pytest.mark.parametrize("height", [0.15, 0.4, 0.8, 1.4])
def test_nothing_stands_within_the_clearance_of_the_route(world, height):
    route = world.scene.demo_route()[::5]
    bearing = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    ground = world.scene.terrain.height(route[:, :2])
    origins = np.repeat(np.column_stack([route[:, :2], ground + height]), len(bearing), axis=0)
    slope = np.repeat(world.scene.terrain.slope(route[:, :2]), len(bearing), axis=0)
    flat = np.tile(np.column_stack([np.cos(bearing), np.sin(bearing)]), (len(route), 1))
    directions = np.column_stack([flat, (flat * slope).sum(-1)])
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    ranges, material, _ = world.cast_rays(origins, directions)
    assert ranges[material > 0].min() > 1.5


def test_the_route_is_level_enough_to_drive(world):
    slope = world.scene.terrain.slope(world.scene.demo_route()[:, :2])
    assert np.degrees(np.arctan(np.linalg.norm(slope, axis=-1))).max() < 12.0


def test_the_vehicle_stands_on_the_ground_along_its_normal(world):
    world.place(3.0, -2.0, 0.7)
    T = world.T_world_vehicle
    down, material, normal = world.cast_rays(T[None, :3, 3] + [0.0, 0.0, 1.0], np.array([[0.0, 0.0, -1.0]]))
    assert down[0] == pytest.approx(1.0, abs=0.02)
    assert material[0] == 0
    assert normal[0] @ T[:3, 2] > 0.999
    assert np.arctan2(T[1, 0], T[0, 0]) == pytest.approx(0.7)


def test_rays_into_the_sky_hit_nothing(world):
    ranges, material, normal = world.cast_rays(np.array([[0.0, 0.0, 50.0]]), np.array([[0.0, 0.0, 1.0]]))
    assert np.isinf(ranges[0])
    assert material[0] == -1
    assert not normal.any()


def test_a_route_larger_than_the_scene_is_refused():
    with pytest.raises(ValueError, match="does not fit"):
        Scene.build(SceneSettings(extent=40.0, route_length=200.0))


def test_the_same_start_and_commands_give_the_same_run(world):
    def run() -> tuple[np.ndarray, np.ndarray]:
        world.place(*world.scene.demo_route()[0])
        for _ in range(50):
            world.step(0.02, (1.0, 0.2))
        return world.T_world_vehicle, np.array(world.wheel_odometry())

    first, second = run(), run()
    assert np.array_equal(first[0], second[0])
    assert np.array_equal(first[1], second[1])
