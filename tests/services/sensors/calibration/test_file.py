"""The calibration as a file: what is written is read, and what is wrong is named."""

import numpy as np
import pytest

from common import geometry
from common.camera import OPTICAL_IN_VEHICLE
from common.errors import ConfigurationError
from services.sensors.calibration.file import MountingTable, load, text
from services.sensors.calibration.simulation import simulated_rig

MOUNTING = MountingTable(position=(0.3, -0.05, 0.8), roll=0.02, pitch=0.15, yaw=-0.4)


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "calibration.toml"
    file.write_text(text(simulated_rig(), MOUNTING, ("a remark",)), encoding="utf-8")
    return file


def test_what_is_written_is_read(path):
    stored = load(path)
    truth = simulated_rig()
    assert stored.mounting == MOUNTING
    assert (stored.rig.width, stored.rig.height) == (truth.width, truth.height)
    for lens, true in ((stored.rig.left, truth.left), (stored.rig.right, truth.right)):
        assert np.allclose(lens.matrix, true.matrix, atol=1e-5)
        assert np.allclose(lens.distortion, true.distortion, atol=1e-8)
    assert np.allclose(stored.rig.R, truth.R, atol=1e-8)
    assert np.allclose(stored.rig.T, truth.T, atol=1e-8)


def test_a_mounting_is_its_angles_and_back():
    T = MOUNTING.transform()
    assert geometry.is_transform(T)
    again = MountingTable.of(T)
    assert np.allclose(again.transform(), T)
    assert again.pitch == pytest.approx(MOUNTING.pitch)
    assert np.allclose(MountingTable().transform(), OPTICAL_IN_VEHICLE)


def test_a_camera_that_looks_down_has_a_positive_pitch():
    ahead = MountingTable(pitch=0.2).transform() @ [0.0, 0.0, 1.0, 0.0]
    assert ahead[2] < 0.0 < ahead[0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[calibration.right]", "[calibration.wrong]", "calibration.right"),
        ("width = 480", "width = 4", "calibration.width"),
        ("width = 480", "with = 480", "width"),
        ("fx = 384", "fx = -384", "fx"),
        ("fx = 384.000000", 'fx = "wide"', "fx"),
        ("distortion = [-0.22, ", "distortion = [", "5 or 8"),
        ("position = [0.3, ", "position = [nan, ", "position"),
        ("translation = [-0.12,", "translation = [-1200.0,", "baseline"),
        ("    [0.99", "    [0.19", "rotation"),
        ("[calibration]", "[calibration", "no"),
    ],
)
def test_what_is_wrong_is_named(path, old, new, words):
    content = path.read_text()
    assert old in content
    path.write_text(content.replace(old, new, 1))
    with pytest.raises(ConfigurationError) as error:
        load(path)
    assert words in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match=r"nowhere\.toml.*vtr calibrate"):
        load(tmp_path / "nowhere.toml")
