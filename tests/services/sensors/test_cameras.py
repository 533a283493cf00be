"""The driver of real cameras as a process, with video files as its devices."""

import numpy as np
import pytest

from common import topics
from services.sensors.calibration.file import MountingTable, text
from services.sensors.calibration.rectify import Rectifier
from services.sensors.calibration.simulation import simulated_rig
from tests.processes import Robot, eventually
from tests.services.sensors.video import write_video

SIZE = (96, 64)
MOUNTING = MountingTable(position=(0.2, 0.0, 0.5), pitch=0.1)
TABLES = """
[sensors]
driver = "cameras"
frame_rate = 20.0
calibration = "calibration.toml"
[sensors.cameras]
devices = ["{folder}/both.avi"]
grey = true
"""


def pattern(shift):
    """A pair side by side whose brightness changes along the rows."""
    u = np.arange(SIZE[0])
    row = (100 + 60 * np.sin((u + shift) / 9.0)).astype(np.uint8)
    image = np.tile(row, (SIZE[1], 1))
    return np.hstack([image, image[:, ::-1]])


@pytest.fixture
def robot(tmp_path):
    with Robot(tmp_path, TABLES.format(folder=tmp_path)) as running:
        calibration = text(simulated_rig(SIZE), MOUNTING)
        (tmp_path / "calibration.toml").write_text(calibration, encoding="utf-8")
        yield running


def test_frames_are_rectified_and_a_lost_camera_is_opened_again(robot, tmp_path):
    frame = pattern(3)
    video = write_video(tmp_path / "both.avi", [frame] * 12)
    frames = robot.bus("operator").subscribe(topics.STEREO)
    robot.start("sensors")
    message = eventually(lambda: (last := frames.last()) and last.message, "a frame", 30.0)
    rectifier = Rectifier.of(simulated_rig(SIZE), MOUNTING.transform())
    left, right = rectifier.rectify(frame[:, : SIZE[0]].copy(), frame[:, SIZE[0] :].copy())
    assert np.abs(message.left.astype(int) - left).max() <= 3
    assert np.abs(message.right.astype(int) - right).max() <= 3
    assert message.camera.baseline == pytest.approx(rectifier.camera.baseline, abs=1e-6)
    assert np.allclose(message.camera.T_vehicle_camera, MOUNTING.transform())
    # The file ends, is opened again and plays anew; then it is gone, and comes back with other images.
    eventually(lambda: "delivers no images any more" in robot.log("sensors"), "its end is reported", 30.0)
    video.unlink()
    eventually(lambda: "there is no camera" in robot.log("sensors"), "its absence is reported", 30.0)
    assert robot.alive("sensors")
    seen = frames.last().message.stamp
    write_video(tmp_path / "both.avi", [frame] * 12)
    eventually(lambda: frames.last().message.stamp > seen, "frames are back", 30.0)


def test_one_of_two_cameras_may_be_unplugged_and_come_back(robot, tmp_path):
    """Two devices, in colour; the right one is pulled out, and the driver says which, and goes on when it is back."""
    devices = f'["{tmp_path}/left.avi", "{tmp_path}/right.avi"]'
    tables = robot.config.read_text().replace(f'["{tmp_path}/both.avi"]', devices)
    robot.config.write_text(tables.replace("grey = true", "grey = false"))
    red, green = np.zeros((SIZE[1], SIZE[0], 3), np.uint8), np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    red[..., 0], green[..., 1] = 200, 150
    write_video(tmp_path / "left.avi", [red] * 200)
    right = write_video(tmp_path / "right.avi", [green] * 12)
    frames = robot.bus("operator").subscribe(topics.STEREO)
    robot.start("sensors")
    message = eventually(lambda: (last := frames.last()) and last.message, "a frame", 30.0)
    middle = message.left[SIZE[1] // 2, SIZE[0] // 2], message.right[SIZE[1] // 2, SIZE[0] // 2]
    assert np.abs(np.array(middle, int) - [[200, 0, 0], [0, 150, 0]]).max() <= 6
    right.unlink()
    eventually(lambda: "there is no camera" in robot.log("sensors"), "its absence is reported", 30.0)
    assert "right.avi" in robot.log("sensors").split("there is no camera")[1]
    seen = frames.last().message.stamp
    write_video(right, [green] * 12)
    eventually(lambda: frames.last().message.stamp > seen, "frames are back", 30.0)


def test_images_of_another_size_are_reported_and_not_published(robot, tmp_path):
    write_video(tmp_path / "both.avi", [np.zeros((48, 96), np.uint8)] * 12)
    frames = robot.bus("operator").subscribe(topics.STEREO)
    robot.start("sensors")
    eventually(
        lambda: "48x48 pixels an image, the calibration is for 96x64" in robot.log("sensors"), "it is said", 30.0
    )
    assert frames.last() is None
    assert robot.alive("sensors")


def test_a_robot_without_a_calibration_is_told_to_make_one(robot, tmp_path):
    (tmp_path / "calibration.toml").unlink()
    with pytest.raises(AssertionError, match="vtr calibrate"):
        robot.start("sensors")
