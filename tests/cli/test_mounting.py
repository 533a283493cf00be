"""``vtr calibrate mounting``: a figure of eight in the synthetic world, recorded or live, tells the camera's place."""

import json
import threading
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest

from common import topics
from common.messages import CameraModel, StereoFrame, WheelOdometry
from services.sensors.calibration import file
from services.sensors.calibration.simulation import simulated_rig
from services.sensors.recordings.mcap import McapWriter, open_mcap
from services.sensors.recordings.mcap.writer import Origin
from services.sensors.world import World
from services.sensors.world.settings import WorldSettings
from tests.processes import Robot

MOUNTING = file.MountingTable(position=(0.32, 0.11, 0.74), roll=0.02, pitch=0.15, yaw=-0.05)
START, STEP_S, FRAME = 1_700_000_000_000_000_000, 0.02, 5
SPEED, TURN, LATE_NS = 0.9, 1.1, 30_000_000


@pytest.fixture(scope="module")
def eight(tmp_path_factory):
    """A lap: images at 10 Hz, wheels at 50 Hz whose stamps are late, of a base that slips on ground that is uneven."""
    folder = tmp_path_factory.mktemp("eight")
    rig = WorldSettings().rig
    size = {"width": 400, "height": 250, "fx": 265.6, "fy": 265.6, "cx": 199.5, "cy": 124.5}
    rig = replace(rig, **size, T_vehicle_camera=MOUNTING.transform())
    world = World(WorldSettings(rig=rig))
    world.warm_up(lidar=False)
    circle, straight = round(2.1 * np.pi / TURN / STEP_S), round(0.8 / STEP_S)
    turns = [TURN] * circle + [0.0] * straight + [-TURN] * circle + [0.0] * straight
    origin = Origin("sensors", "a")
    with McapWriter(folder, "r1", 10**10) as writer:
        for n, turn in enumerate(turns):
            at = START + round(n * STEP_S * 1e9)
            v, w = world.wheel_odometry()
            report = WheelOdometry(stamp=at + LATE_NS, v=v, w=w)
            writer.write(topics.WHEEL_ODOMETRY, "sensor/odometry", report, origin, n, at)
            if n % FRAME == 0:
                left, right = world.render()
                frame = StereoFrame(stamp=at, camera=CameraModel.of(rig), left=left, right=right)
                writer.write(topics.STEREO, "sensor/stereo/front", frame, origin, n // FRAME, at)
            world.step(STEP_S, (SPEED, turn))
    return folder


def check(figures):
    """As exact as is said, and as is useful."""
    off = np.abs(np.array(figures["position_m"]) - MOUNTING.position)
    assert off[:2].max() < 0.03
    assert (off[:2] < 4 * np.array(figures["position_sigma_m"])).all()
    for name in ("roll", "pitch", "yaw"):
        assert figures[f"{name}_deg"] == pytest.approx(np.degrees(getattr(MOUNTING, name)), abs=0.5)
    assert figures["wheel_delay_s"] == pytest.approx(LATE_NS * 1e-9, abs=0.02)
    assert figures["slipped"] < 0.2


def test_a_recorded_eight_becomes_a_mounting_with_a_report(vtr, eight, tmp_path, write_config):
    calibration = tmp_path / "calibration.toml"
    text = file.text(simulated_rig(), file.MountingTable(position=(0.0, 0.0, 0.74)), ("Made by hand.",))
    calibration.write_text(text + "# kept at the end\n", encoding="utf-8")
    write_config('[sensors]\ndriver = "cameras"\ncalibration = "calibration.toml"\n')
    result = vtr("calibrate", "mounting", eight, "--report", "report", "--json")
    assert result.code == 0, result.err
    figures = json.loads(result.out)
    check(figures)
    assert (figures["output"], figures["position_m"][2]) == (str(calibration), 0.74)
    stored = file.load(calibration)
    assert stored.mounting.yaw == pytest.approx(np.radians(figures["yaw_deg"]), abs=1e-4)
    assert stored.rig.baseline == pytest.approx(simulated_rig().baseline, abs=1e-6)
    kept = calibration.read_text()
    assert "# Made by hand." in kept
    assert "# kept at the end" in kept
    assert json.loads((tmp_path / "report" / "report.json").read_text())["slipped"] == figures["slipped"]
    assert cv2.imread(str(tmp_path / "report" / "drive.png")).shape[1] > 1000


def test_a_live_eight_becomes_a_mounting(vtr, eight, tmp_path, monkeypatch):
    """The robot's sensors play the drive; the command ends by itself when it has seen enough."""
    monkeypatch.setattr("cli.mounting.run.ENOUGH_RAD", np.radians(350.0))
    with Robot(tmp_path) as robot:
        sensors = robot.act_as("sensors")
        frames, wheels = sensors.publisher(topics.STEREO, "front"), sensors.publisher(topics.WHEEL_ODOMETRY)
        stop = threading.Event()

        def publish():
            time.sleep(2.0)
            while not stop.is_set():
                for entry in open_mcap(eight).entries():
                    (frames if entry.topic is topics.STEREO else wheels).put(entry.message)
                    if stop.wait(0.045 if entry.topic is topics.STEREO else 0.0):
                        return

        driving = threading.Thread(target=publish)
        driving.start()
        try:
            result = vtr("calibrate", "mounting", "--config", robot.config, "--height", "0.74", "--duration", "90")
        finally:
            stop.set()
            driving.join()
    assert result.code == 0, result.err
    assert "[calibration.mounting]" in result.out
    assert "camera: 0.3" in result.out


def test_a_drive_that_is_too_short_is_refused_and_nothing_is_written(vtr, eight, tmp_path):
    calibration = tmp_path / "c.toml"
    calibration.write_text(file.text(simulated_rig(), file.MountingTable()), encoding="utf-8")
    before = calibration.read_text()
    short = vtr("calibrate", "mounting", eight, "-o", "c.toml", "--height", "0.7", "--duration", "3")
    assert short.code == 1
    assert "drive a figure of eight" in short.sentence
    assert calibration.read_text() == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--height", "0.7"), "no robot is named"),
        (("nowhere", "--height", "0.7"), "there is no file or folder"),
        (("{eight}",), "--height"),
        (("{eight}", "--height", "0.7", "-o", "missing.toml"), "missing.toml"),
        (("{eight}", "--height", "0.7", "--name", "rear"), "has no sensor/stereo/rear"),
        (("{eight}", "--height", "0.7", "--map", "/odom=sensor/odometry"), "is no ROS bag"),
    ],
)
def test_what_cannot_be_is_one_sentence(vtr, eight, arguments, words):
    result = vtr("calibrate", "mounting", *(str(eight) if text == "{eight}" else text for text in arguments))
    assert result.code == 1
    assert words in result.sentence
