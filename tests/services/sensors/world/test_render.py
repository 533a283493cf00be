from __future__ import annotations

from datetime import UTC, datetime

import cv2
import numpy as np
import pytest

from common.geometry import apply, inverse
from services.sensors.world import World

PLACES = (0, 150, 300, 450, 600)


def pixel_rays(world, baseline=0.0):
    """Origins and unit directions in the world of every pixel of a camera, and its rays' lengths at depth one."""
    c = world.camera
    u, v = np.meshgrid(np.arange(c.width), np.arange(c.height))
    rays = np.stack([(u - c.cx) / c.fx, (v - c.cy) / c.fy, np.ones(u.shape)], axis=-1).reshape(-1, 3)
    T = world.T_world_vehicle @ c.T_vehicle_camera
    length = np.linalg.norm(rays, axis=-1)
    origin = T[:3, 3] + baseline * T[:3, 0]
    return np.broadcast_to(origin, rays.shape), rays @ T[:3, :3].T / length[:, None], length


@pytest.mark.parametrize("place", PLACES)
def test_rendered_depth_is_what_rays_measure(world, place):
    world.place(*world.scene.demo_route()[place])
    depth = world.render_depth()
    origins, directions, length = pixel_rays(world)
    ranges, _, _ = world.cast_rays(origins, directions)
    truth = (ranges / length).reshape(depth.shape)
    seen = np.isfinite(truth) & np.isfinite(depth) & (truth < 100.0)
    assert (np.isfinite(truth) == np.isfinite(depth)).mean() > 0.998
    relative = np.abs(depth[seen] - truth[seen]) / truth[seen]
    # Rays are single precision; at silhouettes a ray may pass just beside the edge that a sample hits.
    assert np.quantile(relative, 0.99) < 1e-3
    assert np.median(relative) < 1e-5


@pytest.mark.parametrize("place", PLACES)
def test_disparity_is_that_of_the_stereo_model(world, place):
    """The right image, moved by fx b / z, is the left one: what shift remains (least squares) is a few hundredths."""
    world.place(*world.scene.demo_route()[place])
    left, right = (cv2.cvtColor(i, cv2.COLOR_RGB2GRAY) for i in world._renderer.stereo(world.T_world_vehicle))
    depth, c = world.render_depth(), world.camera
    u, v = np.meshgrid(np.arange(c.width, dtype=np.float32), np.arange(c.height, dtype=np.float32))
    moved = cv2.remap(right, u - (c.fx * c.baseline / depth).astype(np.float32), v, cv2.INTER_CUBIC)
    slope = np.stack([cv2.Sobel(left, cv2.CV_32F, 1, 0) / 8.0, cv2.Sobel(left, cv2.CV_32F, 0, 1) / 8.0], axis=-1)
    # What one camera sees and the other does not differs much.
    seen = (depth > 1.0) & (depth < 8.0) & (u > 60) & (np.abs(moved - left) < 0.3 * (moved + left))
    assert seen.sum() > 5000
    shift = np.linalg.lstsq(slope[seen], (moved - left)[seen], rcond=None)[0]
    assert np.abs(shift).max() < 0.04


def test_motion_moves_corners_as_the_camera_model_says(world):
    x, y, yaw = world.scene.demo_route()[150]
    world.place(x, y, yaw)
    before, depth = cv2.cvtColor(world.render()[0], cv2.COLOR_RGB2GRAY), world.render_depth()
    T_first = world.T_world_vehicle @ world.camera.T_vehicle_camera
    world.place(x + 0.05 * np.cos(yaw), y + 0.05 * np.sin(yaw), yaw + 0.01)
    after = cv2.cvtColor(world.render()[0], cv2.COLOR_RGB2GRAY)
    T_second = world.T_world_vehicle @ world.camera.T_vehicle_camera
    corners = cv2.goodFeaturesToTrack(before, 200, 0.02, 6)[:, 0]
    z = depth[corners[:, 1].astype(int), corners[:, 0].astype(int)]
    corners, z = corners[np.isfinite(z)], z[np.isfinite(z)]
    c = world.camera
    points = np.column_stack([(corners - [c.cx, c.cy]) / [c.fx, c.fy], np.ones(len(z))]) * z[:, None]
    expected = c.project(apply(inverse(T_second) @ T_first, points))[:, :2].astype(np.float32)
    found, ok, _ = cv2.calcOpticalFlowPyrLK(
        before, after, corners, expected.copy(), winSize=(9, 9), maxLevel=0, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    assert np.median(np.abs(found - expected)[ok[:, 0] == 1]) < 0.25


@pytest.mark.parametrize("place", PLACES)
def test_corners_are_found_near_and_far(world, place):
    world.place(*world.scene.demo_route()[place])
    left, _ = world.render()
    depth = world.render_depth()
    keypoints = cv2.FastFeatureDetector_create(20).detect(cv2.cvtColor(left, cv2.COLOR_RGB2GRAY))
    z = np.array([depth[round(k.pt[1]), round(k.pt[0])] for k in keypoints])
    assert ((z > 1.0) & (z < 5.0)).sum() > 100
    assert ((z > 5.0) & (z < 30.0)).sum() > 100


def test_shadows_move_with_the_sun_and_the_night_is_dark(world):
    world.place(*world.scene.demo_route()[150])
    images = []
    for hour in (9, 11, 15):
        world.set_time(datetime(2026, 6, 21, hour, tzinfo=UTC))
        left, _ = world._renderer.stereo(world.T_world_vehicle)
        images.append(left[..., 1] / left[..., 1].mean())
    for a, b in ((0, 1), (1, 2), (0, 2)):
        change = np.abs(np.log((images[a] + 1e-3) / (images[b] + 1e-3)))
        assert (change > 0.7).mean() > 0.03
    world.set_time(datetime(2026, 6, 21, 23, tzinfo=UTC))
    night, _ = world._renderer.stereo(world.T_world_vehicle)
    assert night.mean() < 1e-3 * left.mean()


def test_shade_is_darker_and_bluer_than_sun(world):
    """The same stretch of ground under cast shadow and in the sun."""
    world.place(*world.scene.demo_route()[150])
    light = world._renderer.stereo(world.T_world_vehicle)[0]
    depth, (origins, directions, length) = world.render_depth(), pixel_rays(world)
    hits = origins + directions * (depth.reshape(-1) * length)[:, None]
    ground = world.cast_rays(origins, directions)[1] == 0
    near = ground & (depth.reshape(-1) < 12.0)
    towards_sun = np.broadcast_to(world.light.direction, hits[near].shape)
    ranges, _, _ = world.cast_rays(hits[near] + [0.0, 0.0, 0.05], towards_sun)
    colour = light.reshape(-1, 3)[near]
    lit, shaded = np.isinf(ranges), np.isfinite(ranges)
    assert shaded.sum() > 200
    assert np.median(colour[shaded].sum(-1)) < 0.6 * np.median(colour[lit].sum(-1))
    assert np.median(colour[shaded, 2] / colour[shaded, 0]) > 1.15 * np.median(colour[lit, 2] / colour[lit, 0])


def test_exposure_follows_the_light_slowly(world):
    world.render()
    bright = world._imager.gain
    world.set_time(datetime(2026, 6, 21, 18, 30, tzinfo=UTC))
    world.step(0.1, None)
    world.render()
    soon = world._imager.gain
    for _ in range(80):
        world.step(0.1, None)
        world.render()
    settled = world._imager.gain
    assert bright < soon < 0.5 * (bright + settled)
    image, _ = world.render()
    assert 40 < image[image.shape[0] // 3 :].mean() < 140


def test_images_are_noisy_contiguous_bytes(world):
    first, second = world.render()[0], world.render()[0]
    assert first.shape == (world.camera.height, world.camera.width, 3)
    assert first.dtype == np.uint8
    assert first.flags.c_contiguous
    difference = first.astype(int) - second
    assert 0.2 < difference.std() < 8.0


def test_warm_up_changes_nothing(world):
    world.render()
    gain, pose = world._imager.gain, world.T_world_vehicle
    world.warm_up()
    assert world._imager.gain == gain
    assert np.array_equal(world.T_world_vehicle, pose)


def test_a_robot_goes_on_from_a_stored_state(world):
    for _ in range(100):
        world.step(0.02, (1.0, 0.3))
    stored, pose = world.base_state.to_dict(), world.T_world_vehicle
    world.place(0.0, 0.0, 0.0)
    world.restore(type(world.base_state).from_dict(stored))
    assert np.array_equal(world.T_world_vehicle, pose)
    assert world.twist[0] == pytest.approx(1.0, abs=0.1)
    for _ in range(50):
        world.step(0.02, None)
    assert world.twist == pytest.approx((0.0, 0.0), abs=1e-9)


def test_depth_needs_no_light(world: World):
    world.set_time(datetime(2026, 6, 21, 23, tzinfo=UTC))
    assert np.isfinite(world.render_depth()).mean() > 0.5
