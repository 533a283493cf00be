"""The spinning lidar: ranges and intensities against formulas, and against the world that it spins in."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from common.geometry import apply, inverse
from services.sensors.world import LidarSettings, SceneSettings, World, WorldSettings
from services.sensors.world.geometry import Geometry
from services.sensors.world.lidar import Lidar
from services.sensors.world.mesh import cuboid, surface
from services.sensors.world.rays import RayCaster
from services.sensors.world.spectra import MATERIAL_INDEX, MATERIALS, REFLECTANCES_INFRARED
from services.sensors.world.textures import TextureSet

EXACT = LidarSettings(position=(0.0, 0.0, 0.0), range_noise=(0.0, 0.0))
PLASTER = MATERIAL_INDEX["plaster"]


class Room:
    """Nothing but a white wall that faces the lidar, a ``distance`` ahead, and 400 m wide and high."""

    def __init__(self, distance, albedo, settings=EXACT, texture=None, texel=0.01):
        corners = cuboid([distance + 1.0, 0.0, 0.0], np.eye(3), [1.0, 200.0, 200.0])
        weights = [2.0 * albedo / REFLECTANCES_INFRARED[PLASTER, 0], 0.0, 0.0, 0.0]
        wall = surface(corners, PLASTER, texel, np.random.default_rng(0), weights)
        geometry = Geometry.of((wall,), np.zeros((2, 4)))
        half = np.full((64, 64, 4), 0.5, np.float32) if texture is None else texture
        textures = TextureSet.of([half] * (len(MATERIALS) + 1))
        self.lidar = Lidar(settings, geometry, textures, 0)
        scan = self.lidar.scan(RayCaster(geometry), np.broadcast_to(np.eye(4), (settings.columns, 4, 4)))
        self.ranges, self.intensities = scan.ranges, scan.intensities
        azimuth, elevation = self.lidar.azimuths[None, :], self.lidar.elevations[:, None]
        self.towards = np.cos(azimuth) * np.cos(elevation)
        """Cosine of the angle between each beam and straight ahead, which is that of its incidence."""


def points(lidar, scan):
    """Points (H, W, 3) in the lidar's frame at the moment of firing."""
    azimuth, elevation = lidar.azimuths[None, :], lidar.elevations[:, None]
    flat = np.cos(elevation)
    rays = [np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation) + 0.0 * azimuth]
    return np.stack(rays, axis=-1) * scan.ranges[..., None]


def off_the_scene(world, in_world, poses):
    """How far points (N, 3) are before or behind the surfaces that are seen from lidars at poses (N, 4, 4), metres."""
    eyes = poses[:, :3, 3]
    away = np.linalg.norm(in_world - eyes, axis=-1)
    ranges, _, _ = world.cast_rays(eyes, (in_world - eyes) / away[:, None])
    return np.abs(ranges - away)


def test_a_wall_is_as_far_as_the_formula_says():
    room = Room(5.0, 0.5)
    near = room.towards > 0.3
    assert (room.ranges[near] > 0.0).all()
    assert room.ranges[near] == pytest.approx(5.0 / room.towards[near], rel=1e-5)
    assert not room.ranges[room.towards <= 0.0].any()
    assert not room.intensities[room.towards <= 0.0].any()


def test_flat_ground_is_as_far_as_its_beams_are_inclined():
    bare = SceneSettings(
        extent=64.0, relief=0.0, route_length=50.0,
        trees=0, bushes=0, boxes=0, stones=0, tufts=0, houses=0, walls=0, fences=0,
    )  # fmt: skip
    world = World(WorldSettings(scene=bare, lidar=LidarSettings(beams=48)))
    world.place(0.0, 0.0, 0.4)
    scan = world.scan()
    expected = 1.2 / np.sin(-np.minimum(world.lidar.elevations, -1e-6))
    close = expected < 12.0
    assert close.sum() > 10
    for row, distance in zip(scan.ranges[close], expected[close], strict=True):
        assert (row > 0.0).mean() > 0.99
        assert np.median(row) == pytest.approx(distance, abs=0.004)
        assert np.std(row[row > 0.0]) < 0.05
    assert not scan.ranges[world.lidar.elevations > 0.02].any()


def test_intensity_falls_with_range_and_with_the_root_of_reflectance_and_incidence():
    """255 full_scale / r sqrt(rho cos): that times the range depends on the surface alone."""
    for distance, albedo in ((3.0, 0.36), (6.0, 0.36), (12.0, 0.36), (6.0, 0.72)):
        room = Room(distance, albedo)
        seen = (room.ranges > 0.0) & (room.towards > 0.4)
        expected = 255.0 * EXACT.full_scale / room.ranges[seen] * np.sqrt(albedo * room.towards[seen])
        ratio = room.intensities[seen] / expected
        assert np.median(ratio) == pytest.approx(1.0, abs=0.03)
        # A half of a photon's root of noise, and half a level of rounding, whatever the intensity.
        assert np.std(room.intensities[seen] - expected) == pytest.approx(0.8, abs=0.3)
    assert Room(1.0, 0.9).intensities.max() == 255


def test_dark_surfaces_are_lost_at_the_sensors_reach():
    found = {}
    for distance in (20.0, 45.0, 100.0):
        room = Room(distance, 0.1)
        found[distance] = (room.ranges[room.towards > 0.97] > 0.0).mean()
    assert found[20.0] == 1.0
    assert 0.3 < found[45.0] < 0.7
    assert found[100.0] < 0.02
    assert (Room(100.0, 0.9).ranges > 0.0).any()
    grazing = Room(20.0, 0.1)
    assert (grazing.ranges[(grazing.towards > 0.25) & (grazing.towards < 0.35)] > 0.0).mean() < 0.5


def test_nothing_is_measured_outside_of_the_sensors_ranges():
    settings = replace(EXACT, near=4.0, far=8.0)
    for distance, some in ((3.0, False), (6.0, True), (9.0, False)):
        room = Room(distance, 0.5, settings)
        assert (room.ranges[room.towards > 0.8] > 0.0).any() == some


def test_range_noise_grows_as_light_grows_scarce():
    noisy = replace(EXACT, range_noise=(0.01, 0.08))
    spread = []
    for distance in (3.0, 30.0):
        room = Room(distance, 0.3, noisy)
        seen = (room.ranges > 0.0) & (room.towards > 0.7)
        spread.append(np.std(room.ranges[seen] - distance / room.towards[seen]))
    assert spread[0] == pytest.approx(0.01, rel=0.3)
    assert spread[0] < spread[1] < 0.08


def test_texture_is_seen_near_and_is_a_mean_far_away():
    """Squares of 0.16 m, wider than the spot up to 27 m; of 0.02 m, which is then a quarter of it."""
    side = np.arange(512) // 16
    checks = np.repeat(((side[:, None] + side[None, :]) % 2)[..., None], 4, axis=-1).astype(np.float32)
    for texel, distance, contrast in ((0.01, 4.0, True), (0.01, 10.0, True), (0.00125, 10.0, False)):
        room = Room(distance, 0.36, texture=checks, texel=texel)
        seen = room.towards > 0.9
        surface_ = room.intensities[seen] * distance / room.towards[seen] / (255.0 * EXACT.full_scale)
        relative = np.std(surface_**2) / np.mean(surface_**2)
        assert np.mean(surface_**2) == pytest.approx(0.36, rel=0.15)
        assert (relative > 0.5) if contrast else (relative < 0.15)


def test_columns_turn_from_behind_over_the_left_and_end_now():
    lidar = Room(5.0, 0.5).lidar
    assert (np.diff(lidar.azimuths) < 0.0).all()
    assert lidar.azimuths[[0, -1]] == pytest.approx([np.pi, -np.pi], abs=0.01)
    assert lidar.times[-1] == 0.0
    assert np.diff(lidar.times) == pytest.approx(0.1 / 1024)
    assert lidar.times[0] == pytest.approx(-0.1 * 1023 / 1024)


def test_a_beam_table_is_followed():
    table = (0.1, 0.0, -0.05, -0.4)
    room = Room(5.0, 0.5, replace(EXACT, beam_table=table, columns=64))
    assert room.ranges.shape == (4, 64)
    assert np.array_equal(room.lidar.elevations, table)


@pytest.mark.parametrize(
    "wrong",
    [
        {"rate": 0.0}, {"divergence": -1.0}, {"near": 10.0, "far": 5.0}, {"beams": 1}, {"columns": 4},
        {"lowest": 0.3, "highest": 0.1}, {"beam_table": (0.0, 0.1)}, {"beam_table": (2.0, 0.1)},
        {"range_noise": (-0.1, 0.0)}, {"far": float("nan")},
    ],
)  # fmt: skip
def test_what_is_no_lidar_is_refused(wrong):
    with pytest.raises(ValueError, match=r"must|beams"):
        LidarSettings(**wrong)


def test_a_scan_of_a_standing_robot_lies_on_the_scene(world):
    world.place(*world.scene.demo_route()[150])
    scan, lidar = world.scan(), world.lidar
    seen = scan.ranges > 0.0
    T = world.T_world_vehicle @ lidar.T_vehicle_lidar
    in_world = apply(T, points(lidar, scan)[seen])
    error = off_the_scene(world, in_world, np.broadcast_to(T, (len(in_world), 4, 4)))
    assert np.quantile(error, 0.9) < 0.05
    assert 0.5 < seen.mean() < 0.95


def test_known_motion_takes_the_distortion_out_of_a_scan(world):
    """Driving at 1.5 m/s and turning at 1 rad/s, a turn of the lidar is bent by 15 cm and 6 degrees."""
    world.place(*world.scene.demo_route()[150])
    for _ in range(60):
        world.step(0.02, (1.5, 1.0))
    scan, lidar = world.scan(), world.lidar
    x, y, yaw = world._trail.poses(world.clock + lidar.times).T
    poses = world.scene.terrain.standing(x, y, yaw) @ lidar.T_vehicle_lidar
    end = world.T_world_vehicle @ lidar.T_vehicle_lidar
    assert poses[-1] == pytest.approx(end, abs=1e-6)
    first_to_last = inverse(end) @ poses[0]
    assert np.linalg.norm(first_to_last[:3, 3]) > 0.1
    seen = scan.ranges > 0.0
    column = np.broadcast_to(np.arange(len(poses)), seen.shape)[seen]
    own = points(lidar, scan)[seen]
    undistorted = np.einsum("nij,nj->ni", poses[column, :3, :3], own) + poses[column, :3, 3]
    as_if_at_rest = apply(end, own)
    seen_from = np.broadcast_to(end, (len(own), 4, 4))
    fine, bent = (np.median(off_the_scene(world, p, seen_from)) for p in (undistorted, as_if_at_rest))
    assert fine < 0.02
    assert bent > 2.0 * fine
    assert np.quantile(off_the_scene(world, undistorted, poses[column]), 0.9) < 0.05


def test_the_sun_changes_nothing(world: World):
    scans = []
    for time in (datetime(2026, 6, 21, 9, tzinfo=UTC), datetime(2026, 6, 21, 23, tzinfo=UTC)):
        world.set_time(time)
        lidar = Lidar(world.settings.lidar, world._geometry, world.scene.textures, 5)
        poses = np.broadcast_to(world.T_world_vehicle, (len(lidar.times), 4, 4))
        scans.append(lidar.scan(world._rays, poses))
    assert np.array_equal(scans[0].ranges, scans[1].ranges)
    assert np.array_equal(scans[0].intensities, scans[1].intensities)


def test_scans_differ_by_their_noise_alone(world):
    first, second = world.scan(), world.scan()
    both = (first.ranges > 0.0) & (second.ranges > 0.0)
    assert (both == (first.ranges > 0.0)).mean() > 0.97
    change = first.intensities[both].astype(int) - second.intensities[both]
    assert 0.5 < change.std() < 2.5
    assert 0.005 < np.std(first.ranges[both] - second.ranges[both]) < 0.1
    levels = first.intensities[both]
    # The scene is no grey mass: near things have many levels, and much more spread than noise.
    assert levels.std() > 10.0 * change.std()


def test_no_camera_is_made_for_scans_alone():
    world = World(WorldSettings(scene=SceneSettings(extent=64.0, trees=2, stones=0, tufts=0)))
    world.warm_up(cameras=False)
    world.set_time(datetime(2026, 6, 21, 23, tzinfo=UTC))
    assert (world.scan().ranges > 0.0).any()
    assert "_renderer" not in vars(world)
