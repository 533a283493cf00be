import numpy as np

from services.estimator.lidar import LidarSettings, beams, images, keypoints, model
from tests.services.estimator.lidar.scene import cast, scan

SETTINGS = LidarSettings()
EXACT = scan(noise=0.0)
STACK = images.form(EXACT, beams.estimate_geometry(EXACT), SETTINGS.image)


def measure(places, stack=STACK):
    points = np.asarray(places, dtype=np.float32).reshape(-1, 2)
    detected = np.stack([points[:, 0], (points[:, 1] + 0.5) * stack.row_scale - 0.5], -1)
    scales = np.full(len(points), 2.0, np.float32)
    return keypoints.measure(detected, scales, stack, SETTINGS.keypoints, SETTINGS.noise)


def _smooth_places(rng, count):
    """Places away from edges of the scene's ranges."""
    ranges = np.where(STACK.range > 0, STACK.range, np.nan)
    jump = np.abs(np.diff(ranges, axis=1)) > 0.02 * ranges[:, :-1]
    rows, columns = rng.integers(4, 60, count), rng.integers(8, 1010, count)
    fine = [
        not jump[r - 2 : r + 3, c - 5 : c + 5].any() and STACK.range[r - 2 : r + 3, c - 5 : c + 5].all()
        for r, c in zip(rows, columns, strict=True)
    ]
    return np.stack([columns, rows], -1)[fine]


def test_what_is_measured_between_pixels_lies_on_the_surface():
    rng = np.random.default_rng(0)
    places = _smooth_places(rng, 300) + rng.uniform(-0.5, 0.5, 2)
    measurements, covariances, _, good = measure(places)
    assert good.mean() > 0.8
    points = model.to_points(measurements[good])
    on_ground = np.abs(points[:, 2] + 1.7) < 0.01
    assert on_ground.sum() > 50
    assert np.median(np.abs(points[on_ground, 2] + 1.7)) < 1e-3
    assert (np.linalg.eigvalsh(covariances[good]) > 0).all()
    assert 0.05 < np.degrees(np.sqrt(covariances[good][:, 0, 0])).mean() < 1.0


def test_an_error_of_place_moves_a_keypoint_along_its_surface():
    places = np.array([[512.0, 50.0]])
    measurements, covariances, _, good = measure(places)
    assert good[0]
    J = model.point_jacobians(measurements[0])
    in_space = J @ covariances[0] @ J.T
    vertical, horizontal = np.sqrt(in_space[2, 2]), np.sqrt(in_space[:2, :2].trace())
    assert vertical < 0.04
    assert horizontal > 2 * vertical


def test_edges_and_holes_have_no_keypoints():
    ranges, _ = cast(np.eye(4))
    rows, columns = np.nonzero((ranges[:, :-1] > 0) & (np.diff(ranges, axis=1) > 2.0) & (ranges[:, 1:] < 15.0))
    inside = (rows > 4) & (rows < 60)
    places = np.stack([columns[inside] + 0.5, rows[inside]], -1)
    assert len(places) > 20
    assert measure(places)[3].mean() < 0.05
    holed = EXACT.points.copy()
    holed[:, 500:530] = 0.0
    stack = images.form(scan_of(holed), beams.estimate_geometry(EXACT), SETTINGS.image)
    assert not measure([[515.0, 50.0], [500.0, 40.0]], stack)[3].any()


def scan_of(points):
    return type(EXACT)(0, points, EXACT.intensity)


def test_a_keypoint_at_the_seam_is_measured_across_it():
    measurements, _, _, good = measure([[1023.4, 50.0], [0.2, 50.0], [1023.6, 50.0]])
    assert good.all()
    assert (np.abs(measurements[:, 0]) > 3.1).all()
    assert np.ptp(measurements[:, 2]) < 0.01
