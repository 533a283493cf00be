"""Known cameras are recovered from rendered boards, and every bad set is refused with its reason."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from common import geometry
from services.sensors.calibration.board import Board
from services.sensors.calibration.calibrate import calibrate
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.report import vertical_errors
from services.sensors.calibration.rig import Lens, StereoRig
from services.sensors.calibration.simulation import BOARD, SIZE, BoardRenderer, simulated_poses, simulated_rig
from services.sensors.calibration.views import MIN_VIEWS


@pytest.fixture(scope="module")
def result(good_set):
    return calibrate(good_set, BOARD)


def refusal(pairs, board=BOARD, **options):
    with pytest.raises(CalibrationError) as error:
        calibrate(pairs, board, **options)
    sentence = str(error.value)
    assert "\n" not in sentence
    return sentence


def test_the_cameras_are_recovered(result):
    found, truth = result.found.solution.rig, simulated_rig()
    for lens, true in ((found.left, truth.left), (found.right, truth.right)):
        assert lens.fx == pytest.approx(true.fx, rel=2e-3)
        assert lens.fy == pytest.approx(true.fy, rel=2e-3)
        assert np.allclose([lens.cx, lens.cy], [true.cx, true.cy], atol=1.0)
    assert found.baseline == pytest.approx(truth.baseline, rel=2e-3)
    assert np.degrees(np.linalg.norm(cv2.Rodrigues(found.R @ truth.R.T)[0])) < 0.1
    assert result.quality.rms < 0.3


def rig(size, focal, distortion, baseline):
    """Two lenses that differ by a hundredth, and are not quite parallel."""
    width, height = size
    left = Lens(focal, 1.002 * focal, width / 2 - 4.3, height / 2 + 3.1, np.array(distortion))
    right = Lens(1.01 * focal, 1.011 * focal, width / 2 + 5.2, height / 2 - 2.4, 0.97 * np.array(distortion))
    return StereoRig(
        width, height, left, right, geometry.so3_exp([0.01, -0.015, 0.006]), np.array([-baseline, 0.0015, 0.002])
    )


@pytest.mark.parametrize(
    ("board", "truth", "look"),
    [
        (
            Board(8, 6, 0.05, 0.037, "6X6_250"),
            rig((752, 480), 400.0, (-0.3, 0.12, 0.0003, 0.0002, -0.022), 0.11),
            {"blur": 0.6, "noise": 3.0, "vignetting": 0.6},
        ),
        (
            Board(6, 4, 0.06, 0.045, "APRILTAG_36h11"),
            rig((640, 480), 600.0, (0.12, -0.05, 0.001, 0.001, 0.0), 0.06),
            {"blur": 0.9, "noise": 4.0, "vignetting": 0.4},
        ),
        (
            Board(9, 6, 0.03, 0.022, "4X4_50"),
            rig((400, 300), 300.0, (-0.2, 0.06, 0.0005, 0.0005, 0.0), 0.2),
            {"blur": 0.6, "noise": 2.0, "vignetting": 0.3},
        ),
    ],
    ids=["wide with dark corners", "pincushion, soft and noisy", "coarse with a long baseline"],
)
def test_other_boards_and_lenses_are_recovered_too(board, truth, look):
    result = calibrate(BoardRenderer(truth, board).framed(15, **look), board)
    found = result.found.solution.rig
    for lens, true in ((found.left, truth.left), (found.right, truth.right)):
        assert [lens.fx, lens.fy] == pytest.approx([true.fx, true.fy], rel=2e-3)
    assert found.baseline == pytest.approx(truth.baseline, rel=2e-3)
    assert result.quality.rms < 0.3


def test_mirrored_images_are_refused(good_set):
    few = good_set[:4]
    mirrored = [(name, left[:, ::-1].copy(), right[:, ::-1].copy()) for name, left, right in few]
    assert "the images are mirrored" in refusal(mirrored)
    assert "the images are mirrored" in refusal(mirrored, any_dictionary=True)
    assert "one camera's images are mirrored" in refusal(
        [(n, left, m) for (n, left, _), (_, _, m) in zip(few, mirrored, strict=True)]
    )


def test_what_is_uncertain_is_said_in_proportion(renderer, result):
    found, truth, quality = result.found.solution.rig, simulated_rig(), result.quality
    errors = (found.left.fx / truth.left.fx - 1, found.right.fx / truth.right.fx - 1)
    assert all(abs(e) < 4 * s < 0.004 for e, s in zip(errors, quality.focal_sigma, strict=True))
    assert abs(found.baseline / truth.baseline - 1) < 4 * quality.baseline_sigma < 0.004
    few = calibrate(renderer.pairs(MIN_VIEWS, noise=6.0), BOARD).quality
    assert max(few.focal_sigma) > max(quality.focal_sigma)


def test_a_lens_that_needs_no_rational_model_is_recovered_by_it(good_set):
    found = calibrate(good_set, BOARD, coefficients=8).found.solution.rig
    assert found.left.fx == pytest.approx(simulated_rig().left.fx, rel=2e-3)
    assert found.baseline == pytest.approx(simulated_rig().baseline, rel=2e-3)
    assert np.abs(found.left.distortion).max() < 2.0


def test_corners_lie_on_one_row_after_rectification(result):
    vertical = vertical_errors(result.found, result.rectifier)
    assert len(vertical) > 100
    assert np.sqrt((vertical**2).mean()) < 0.15


def test_the_rectified_camera_measures_true_distances(renderer, result):
    """The board's own squares, triangulated from rectified images, have the side that they have."""
    T = simulated_poses(1, np.random.default_rng(9))[0]
    pair = renderer.pair(T, np.random.default_rng(9))
    left, right = result.rectifier.rectify(*pair)
    detector = cv2.aruco.CharucoDetector(BOARD.opencv())
    (a, ids_a, *_), (b, ids_b, *_) = (detector.detectBoard(image) for image in (left, right))
    ids, at_a, at_b = np.intersect1d(ids_a, ids_b, return_indices=True)
    first, second = a.reshape(-1, 2)[at_a], b.reshape(-1, 2)[at_b]
    assert np.abs(first[:, 1] - second[:, 1]).max() < 0.5
    points = result.rectifier.camera.triangulate(np.column_stack([first, second[:, 0]]))
    planned = BOARD.corners[ids]
    far = np.linalg.norm(points[0] - points[-1]), np.linalg.norm(planned[0] - planned[-1])
    assert far[0] == pytest.approx(far[1], rel=0.01)


def test_every_rectified_pixel_was_seen(result):
    white = np.full((SIZE[1], SIZE[0]), 255, np.uint8)
    assert all(image.min() == 255 for image in result.rectifier.rectify(white, white))


def test_the_dictionary_is_found_out(good_set):
    named = replace(BOARD, dictionary="4X4_50")
    assert calibrate(good_set, named, any_dictionary=True).board.dictionary.startswith("5X5")


def test_a_board_of_the_old_pattern_is_recognised():
    board = Board(7, 6, 0.04, 0.03, "5X5_100", legacy=True)
    found = calibrate(BoardRenderer(simulated_rig(), board).pairs(10), replace(board, legacy=False))
    assert found.board == board
    assert found.quality.rms < 0.3


def test_a_pair_of_two_moments_is_dropped_with_the_reason(good_set):
    spoilt = [*good_set]
    spoilt[3] = (spoilt[3][0], spoilt[3][1], np.roll(spoilt[3][2], 6, axis=0))
    found = calibrate(spoilt, BOARD)
    assert list(found.dropped) == ["003"]
    assert "same moment" in found.dropped["003"]
    assert found.found.solution.rig.left.fx == pytest.approx(simulated_rig().left.fx, rel=2e-3)


def test_bad_views_are_dropped_and_the_rest_is_used(good_set):
    name, left, right = good_set[0]
    soft = (cv2.GaussianBlur(left, (0, 0), 3.0), right)
    spoilt = [*good_set, ("soft", *soft), ("again", left, right), ("dark", np.zeros_like(left), right)]
    dropped = calibrate(spoilt, BOARD).dropped
    assert list(dropped) == ["soft", "again", "dark"]
    assert "blurred" in dropped["soft"]
    assert f"as in {name}" in dropped["again"]
    assert "no contrast" in dropped["dark"]


@pytest.mark.parametrize("blur", [2.5, 5.0])
def test_a_blurred_set_is_refused(renderer, blur):
    assert "blurred" in refusal(renderer.pairs(10, blur=blur))


def test_a_set_of_one_pose_is_refused(renderer, good_set):
    rng = np.random.default_rng(4)
    T = simulated_poses(1, rng)[0]
    assert "hardly moves" in refusal([(f"{k}", *renderer.pair(T, rng)) for k in range(10)])
    assert "hardly moves" in refusal([(f"{k}", *good_set[0][1:]) for k in range(10)])


def test_boards_that_are_all_parallel_are_refused(renderer):
    rng = np.random.default_rng(4)
    flat = simulated_poses(12, rng, tilt=0.0)
    flat[:, :3, :3] = np.eye(3)
    flat[:, :3, 3] += np.array([-0.14, -0.1, 0.0]) * 0.5
    assert "tilt" in refusal([(f"{k}", *renderer.pair(T, rng)) for k, T in enumerate(flat)])


@pytest.mark.parametrize(
    ("board", "words"),
    [
        (Board(5, 7, 0.04, 0.03), "7x5"),
        (Board(9, 6, 0.04, 0.03), "7x5"),
        (Board(7, 3, 0.04, 0.03), "7x5"),
        (Board(7, 5, 0.04, 0.03, "6X6_250"), "5X5"),
        (Board(7, 5, 0.04, 0.02), "0.7"),
    ],
)
def test_another_board_is_refused_and_named(good_set, board, words):
    assert words in refusal(good_set, board)


def test_swapped_cameras_are_refused(good_set):
    assert "swapped" in refusal([(name, right, left) for name, left, right in good_set])


def test_one_camera_twice_is_refused(good_set):
    assert "one camera" in refusal([(name, left, left) for name, left, _ in good_set])


def test_pairs_that_do_not_belong_together_are_refused(good_set):
    shifted = [(name, left, good_set[(k + 1 + k % 3) % len(good_set)][2]) for k, (name, left, _) in enumerate(good_set)]
    assert "agree with each other" in refusal(shifted)


def test_too_few_are_refused(good_set):
    assert f"{MIN_VIEWS} are needed" in refusal(good_set[:5])
    assert "no pairs" in refusal([])


def test_images_without_a_board_are_refused():
    rng = np.random.default_rng(0)
    noise = [(f"{k}", *rng.integers(0, 255, (2, 320, 480), dtype=np.uint8)) for k in range(9)]
    assert "no marker" in refusal(noise)
    assert "no marker" in refusal(noise, any_dictionary=True)


def test_images_of_two_sizes_are_refused(good_set):
    name, left, right = good_set[2]
    assert "480x160" in refusal([*good_set[:2], (name, left[:160], right), *good_set[3:]])


@pytest.mark.parametrize(
    ("size", "sides", "dictionary"),
    [((2, 5), (0.04, 0.03), "5X5_100"), ((7, 5), (0.03, 0.04), "5X5_100"), ((7, 5), (0.04, -1.0), "5X5_100"),
     ((7, 5), (0.04, 0.03), "5X5"), ((20, 20), (0.04, 0.03), "5X5_100")],
)  # fmt: skip
def test_a_board_that_cannot_be_is_refused(size, sides, dictionary):
    with pytest.raises(CalibrationError):
        Board(*size, *sides, dictionary)
