"""Pairs of images are found in every layout that people use."""

import cv2
import numpy as np
import pytest

from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.pairs import find_pairs


def image(path, level, width=20):
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((16, width), level, np.uint8))


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("left/{}.png", "right/{}.png"),
        ("left_{}.png", "right_{}.png"),
        ("left{}.jpg", "right{}.jpg"),
        ("{}_l.png", "{}_r.png"),
        ("cam-Left_{}.png", "cam-Right_{}.png"),
    ],
)
def test_pairs_are_found(tmp_path, left, right):
    for k in range(2):
        image(tmp_path / left.format(f"{k:02d}"), 10 * k)
        image(tmp_path / right.format(f"{k:02d}"), 10 * k + 100)
    found = list(find_pairs(tmp_path))
    assert [(round(a.mean()), round(b.mean())) for _, a, b in found] == [(0, 100), (10, 110)]


def test_one_image_holds_both(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.hstack([np.full((16, 20), 30, np.uint8), np.full((16, 20), 60, np.uint8)]))
    ((name, left, right),) = find_pairs(tmp_path, side_by_side=True)
    assert (name, left.mean(), right.mean(), left.shape) == ("a", 30, 60, (16, 20))
    image(tmp_path / "odd.png", 1, width=21)
    with pytest.raises(CalibrationError, match="odd"):
        list(find_pairs(tmp_path, side_by_side=True))


def test_an_image_without_a_partner_is_named(tmp_path):
    for name in ("left_1", "right_1", "left_2", "notes"):
        image(tmp_path / f"{name}.png", 1)
    folder = find_pairs(tmp_path)
    assert len(folder) == 1
    assert folder.lonely == ("left 2",)


def test_a_folder_without_pairs_is_refused(tmp_path):
    with pytest.raises(CalibrationError, match="no folder"):
        find_pairs(tmp_path / "nowhere")
    image(tmp_path / "a.png", 1)
    with pytest.raises(CalibrationError, match="no pairs"):
        find_pairs(tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(CalibrationError, match="no images"):
        find_pairs(tmp_path / "empty", side_by_side=True)
