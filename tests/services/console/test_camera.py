"""Pictures for browsers."""

import cv2
import numpy as np

from common.messages import LidarScan
from services.console.robot.models.camera import header, jpeg, lidar_image, on_lidar_image


def test_a_large_picture_is_made_smaller_and_its_features_stay_where_they_were():
    image = np.zeros((800, 1280, 3), np.uint8)
    image[400:420, 900:920] = (255, 0, 0)
    data, scale = jpeg(image, 80)
    shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    about = header(7, image, scale, np.array([[910.0, 410.0]], np.float32))
    assert shown.shape == (about["height"], about["width"], 3) == (400, 640, 3)
    x, y = about["points"]
    assert shown[y, x].argmax() == 2, "red stays red"


def test_a_small_grey_picture_stays_as_it_is():
    image = np.full((100, 160), 128, np.uint8)
    data, scale = jpeg(image, 80)
    assert scale == 1.0
    assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED).shape == (100, 160)
    assert header(7, image, scale, None)["points"] == []


def test_a_scan_is_shown_with_what_is_far_as_bright_as_what_is_near():
    beams, columns = 16, 64
    ranges = np.full((beams, columns), 5.0, np.float32)
    ranges[:, 32:] = 20.0
    scan = LidarScan(
        stamp=1, T_vehicle_lidar=np.eye(4), ranges=ranges, intensities=(100.0 / ranges).astype(np.float32),
        elevations=np.linspace(0.3, -0.3, beams), azimuths=np.linspace(3.0, -3.0, columns), offsets=np.zeros(columns),
    )  # fmt: skip
    image = lidar_image(scan)
    assert image.shape == (64, 64)
    assert image.min() == image.max() == 255
    bright = scan.model_copy(update={"intensities": np.where(np.arange(beams)[:, None] == 5, scan.intensities, 0.0)})
    rows = np.flatnonzero(lidar_image(bright)[:, 7])
    assert on_lidar_image(np.array([[7.0, 5.0]], np.float32)).tolist() == [[7.0, rows.mean()]]
    nothing = scan.model_copy(update={"ranges": np.zeros_like(ranges)})
    assert lidar_image(nothing).max() == 0
