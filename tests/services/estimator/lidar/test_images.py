"""From a scan, in whatever form, to a stack of images."""

from dataclasses import replace

import numpy as np
import pytest

from common.lidar import LidarScan
from services.estimator.lidar import LidarSettings, ScanError, beams, images
from services.estimator.lidar.scan import check
from tests.services.estimator.lidar.scene import AZIMUTHS, BEAMS, COLUMNS, ELEVATIONS, as_kitti, scan

SETTINGS = LidarSettings().image
SCAN = scan()
KITTI = as_kitti(SCAN)


def form(made, geometry=None):
    return images.form(made, geometry or beams.estimate_geometry(made), SETTINGS)


def rings_of(made):
    """The beam of each point of a scan in KITTI's form."""
    elevation = beams.directions(made.points)[1]
    return np.argmin(np.abs(elevation[:, None] - ELEVATIONS), axis=1)


def test_an_organised_scan_keeps_its_rows_and_columns():
    stack = form(SCAN)
    assert stack.range.shape == (BEAMS, COLUMNS)
    row, column = 40, 123
    assert stack.azimuth[row, column] == pytest.approx(AZIMUTHS[column], abs=1e-5)
    assert stack.elevation[row, column] == pytest.approx(ELEVATIONS[row], abs=1e-5)
    assert stack.range[row, column] == pytest.approx(np.linalg.norm(SCAN.points[row, column]), abs=1e-4)
    assert stack.intensity[row, column] == pytest.approx(
        SCAN.intensity[row, column] * stack.range[row, column], rel=1e-5
    )


def test_rows_are_sorted_from_the_top_whatever_the_order_of_the_beams():
    order = np.random.default_rng(0).permutation(BEAMS)
    mixed = LidarScan(0, SCAN.points[order], SCAN.intensity[order])
    assert np.array_equal(form(mixed).range, form(SCAN).range)


def test_kittis_order_of_points_tells_the_beams():
    geometry = beams.estimate_geometry(KITTI)
    assert geometry.ordered
    np.testing.assert_allclose(geometry.elevations, ELEVATIONS, atol=1e-4)
    stack = form(KITTI, geometry)
    seen = stack.range > 0
    assert seen.mean() == pytest.approx((SCAN.points != 0).any(-1).mean(), abs=0.02)
    np.testing.assert_allclose(stack.elevation[seen], np.broadcast_to(ELEVATIONS[:, None], seen.shape)[seen], atol=1e-4)


@pytest.mark.parametrize("start", [0.3, 2.0, -3.0])
@pytest.mark.parametrize("sense", [1, -1])
def test_a_turn_may_begin_anywhere_and_go_either_way(start, sense):
    turn = (start + sense * np.linspace(0.0, 2 * np.pi, 400, endpoint=False) + np.pi) % (2 * np.pi) - np.pi
    noisy = np.tile(turn, 16) + np.random.default_rng(0).normal(0, 1e-3, 16 * 400)
    rings = beams.rings_by_order(noisy)
    assert (rings == np.repeat(np.arange(16), 400)).mean() > 0.995


def test_a_beam_without_a_return_moves_no_other():
    geometry = beams.estimate_geometry(KITTI)
    without = rings_of(KITTI) != 3
    stack = form(LidarScan(0, KITTI.points[without], KITTI.intensity[without]), geometry)
    assert not (stack.range[0:1] > 0).any() or not (stack.range[3] > 0).any()
    below = stack.range[10:] > 0
    offs = stack.elevation[10:][below] - np.broadcast_to(ELEVATIONS[10:, None], below.shape)[below]
    assert np.abs(offs).max() < 0.012


def test_shuffled_points_need_rings_or_are_cut_by_elevation():
    order = np.random.default_rng(1).permutation(len(KITTI.points))
    rings = rings_of(KITTI)[order]
    shuffled = LidarScan(0, KITTI.points[order], KITTI.intensity[order], rings=rings)
    assert np.array_equal(form(shuffled).range > 0, form(KITTI).range > 0)
    cut = beams.estimate_geometry(replace(shuffled, rings=None))
    assert not cut.ordered
    assert 32 <= cut.rows <= 64


def test_a_beams_own_gain_is_not_seen():
    gains = np.exp(np.random.default_rng(2).normal(0.0, 0.7, BEAMS))
    plain, uneven = form(scan(seed=5)).brightness, form(scan(seed=5, gains=gains)).brightness
    assert np.abs(plain.astype(int) - uneven).max() <= 1


def test_holes_are_filled_for_detection_and_never_for_measurement():
    points = SCAN.points.copy()
    points[30, 200:206] = 0.0
    points[31, 204] = np.nan
    stack, whole = form(LidarScan(0, points, SCAN.intensity)), form(SCAN)
    assert (stack.range[30, 200:206] == 0).all()
    assert stack.range[31, 204] == 0
    here = slice(30 * stack.row_scale, 31 * stack.row_scale), slice(200, 206)
    filled = stack.brightness[here].astype(int)
    ends = whole.brightness[here[0], [199, 206]].astype(int)
    assert filled.min() >= ends.min() - 12
    assert filled.max() <= ends.max() + 12


def test_the_surroundings_of_a_large_hole_are_masked():
    points = SCAN.points.copy()
    points[20:50, 300:400] = 0.0
    stack = form(LidarScan(0, points, SCAN.intensity))
    assert not stack.mask[35 * stack.row_scale, 296:404].any()
    assert stack.mask[35 * stack.row_scale, 500]


@pytest.mark.parametrize(
    ("broken", "sentence"),
    [
        (replace(SCAN, intensity=0.0 * SCAN.intensity), "no intensity"),
        (replace(SCAN, intensity=0.0 * SCAN.intensity + 7.0), "no intensity"),
        (replace(SCAN, intensity=np.nan * SCAN.intensity), "not numbers"),
        (replace(SCAN, intensity=-SCAN.intensity), "negative"),
        (replace(SCAN, intensity=SCAN.intensity[:-1]), "each needs one"),
        (replace(SCAN, points=0.0 * SCAN.points), "empty"),
        (replace(SCAN, points=np.nan * SCAN.points), "empty"),
        (replace(SCAN, points=SCAN.points[..., :2]), r"\(N, 3\)"),
        (replace(SCAN, points=np.zeros((0, 3), np.float32), intensity=np.zeros(0, np.float32)), r"\(N, 3\)"),
        (replace(KITTI, rings=np.full(len(KITTI.points), 9999)), "rings"),
        (replace(KITTI, rings=np.zeros(3, np.int64)), "rings"),
        (replace(KITTI, rings=np.zeros(len(KITTI.points))), "rings"),
        (replace(SCAN, offsets=np.zeros(3, np.float32)), "offsets"),
        (replace(SCAN, offsets=np.full(SCAN.intensity.shape, 1e6, np.float32)), "stamp"),
    ],
)
def test_a_bad_scan_is_refused_with_a_sentence(broken, sentence):
    with pytest.raises(ScanError, match=sentence):
        check(broken)


@pytest.mark.parametrize(
    ("other", "sentence"),
    [
        (LidarScan(0, SCAN.points[:32], SCAN.intensity[:32]), "32x1024"),
        (KITTI, "1x1|64x1024"),
    ],
)
def test_a_scan_of_another_lidar_does_not_fit(other, sentence):
    with pytest.raises(ScanError, match=sentence):
        form(other, beams.estimate_geometry(SCAN))


def test_rings_of_another_beam_table_do_not_fit():
    geometry = beams.estimate_geometry(replace(KITTI, rings=rings_of(KITTI)))
    with pytest.raises(ScanError, match="rings up to"):
        form(replace(KITTI, rings=rings_of(KITTI) + 40), geometry)
