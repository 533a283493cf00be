"""The offline commands: figures and files of real recordings, and a sentence for bad ones."""

import csv
import json

import cv2
import numpy as np
import pytest

from cli.errors import CommandError
from cli.frames import parse_slice

PROJECTION = "100 0 32 {} 0 100 24 0 0 0 1 0\n"


@pytest.fixture
def recording(tmp_path):
    """A folder of two small pairs without anything to see."""
    for side in ("left", "right"):
        (tmp_path / "drive" / side).mkdir(parents=True)
        for index in range(2):
            cv2.imwrite(str(tmp_path / "drive" / side / f"{index:06d}.png"), np.full((48, 64), 128, np.uint8))
    (tmp_path / "drive" / "calib.txt").write_text(PROJECTION.format(0) + PROJECTION.format(-20))
    return tmp_path / "drive"


@pytest.mark.parametrize(
    ("text", "chosen"), [("0::2", [0, 2, 4]), ("1::2", [1, 3]), (":2", [0, 1]), ("3:", [3, 4]), ("1:4:", [1, 2, 3])]
)
def test_a_slice_is_written_as_in_python(text, chosen):
    assert list(range(5))[parse_slice(text, "--frames")] == chosen


@pytest.mark.parametrize("text", ["", "2", "::0", "::-1", "a:b", "1:2:3:4"])
def test_what_is_no_slice_is_refused(text):
    with pytest.raises(CommandError, match="--frames"):
        parse_slice(text, "--frames")


def test_a_calibration_without_baseline_is_refused_and_nothing_written(vtr, recording, tmp_path):
    (recording / "calib.txt").write_text(PROJECTION.format(0) * 2)
    result = vtr("odometry", recording, "-o", tmp_path / "poses.txt")
    assert result.code == 1
    assert "baseline" in result.sentence
    assert not (tmp_path / "poses.txt").exists()


def test_a_truncated_image_is_named(vtr, recording):
    image = recording / "right" / "000001.png"
    image.write_bytes(image.read_bytes()[:40])
    assert "000001.png" in vtr("odometry", recording).sentence


def test_a_missing_image_and_a_missing_folder_are_named(vtr, recording):
    (recording / "right" / "000001.png").unlink()
    assert "right" in vtr("odometry", recording).sentence
    assert "nowhere" in vtr("odometry", "nowhere").sentence


def test_a_file_that_cannot_be_written_is_refused_before_the_work(vtr, recording, tmp_path):
    assert "no folder" in vtr("odometry", recording, "-o", tmp_path / "missing" / "poses.txt").sentence


def test_a_recording_that_shows_nothing_cannot_be_taught(vtr, recording):
    assert "features" in vtr("localize", recording).sentence


def test_odometry_writes_kitti_poses_and_reports_drift(vtr, data_dir, tmp_path):
    result = vtr(
        "odometry", data_dir / "kitti06_gray_stereo", "--frames", ":12", "-o", tmp_path / "poses.txt", "--json"
    )
    figures = json.loads(result.out)
    poses = np.loadtxt(tmp_path / "poses.txt")
    assert result.code == 0
    assert poses.shape == (12, 12)
    assert np.allclose(poses[0].reshape(3, 4), np.eye(4)[:3])
    assert figures["frames"] == 12
    assert figures["lost"] == 0
    assert figures["drift"]["end_point_percent"] < 3


def test_odd_frames_are_localized_on_the_even_ones(vtr, data_dir, tmp_path):
    slices = ("--teach-frames", ":12:2", "--repeat-frames", "1:12:2")
    result = vtr("localize", data_dir / "kitti06_gray_stereo", *slices, "-o", tmp_path / "frames.csv", "--json")
    figures = json.loads(result.out)
    assert figures["coverage"] == 1.0
    assert figures["position_error_m"]["median"] < 0.03
    with (tmp_path / "frames.csv").open() as file:
        assert [row["localized"] for row in csv.DictReader(file)] == ["1"] * 6


def test_a_grey_recording_says_that_it_has_the_plain_stream_alone(vtr, data_dir, tmp_path):
    slices = ("--teach-frames", ":8:2", "--repeat-frames", "1:8:2")
    result = vtr("localize", data_dir / "kitti06_gray_stereo", *slices, "--plot", tmp_path / "both.png")
    assert result.code == 0
    assert "grey: the plain stream alone" in result.out
    assert (tmp_path / "both.png").read_bytes().startswith(b"\x89PNG")


def test_a_colour_recording_is_reported_by_stream_and_drawn(vtr, data_dir, tmp_path):
    slices = ("--teach-frames", ":8:2", "--repeat-frames", "1:8:2")
    files = ("--plot", tmp_path / "plots", "-o", tmp_path / "frames.csv")
    result = vtr("localize", data_dir / "kitti02_colour_stereo", *slices, *files, "--json")
    figures = json.loads(result.out)
    assert figures["streams"]["plain"]["coverage"] == figures["coverage"] == 1.0
    assert "invariant" in figures["streams"]
    assert figures["driven_m"] == pytest.approx(8.4, abs=2.0)
    assert sorted(path.name for path in (tmp_path / "plots").iterdir()) == ["dead_reckoning.png", "localized.png"]
    with (tmp_path / "frames.csv").open() as file:
        assert [row["plain"] for row in csv.DictReader(file)] == ["1"] * 4


def test_a_plot_that_cannot_be_written_is_refused_before_the_work(vtr, recording, tmp_path):
    assert "no folder" in vtr("localize", recording, "--plot", tmp_path / "missing" / "x.png").sentence
    (tmp_path / "file").touch()
    assert "--plot" in vtr("localize", recording, "--plot", tmp_path / "file").sentence


@pytest.fixture
def scans(tmp_path):
    """A folder of two scans of noise."""
    rng = np.random.default_rng(0)
    (tmp_path / "turns" / "velodyne").mkdir(parents=True)
    turn = np.tile(np.linspace(0.0, 2 * np.pi, 400, endpoint=False), 8)
    slope = np.repeat(np.linspace(0.1, -0.3, 8), 400)
    for index in range(2):
        distance = rng.uniform(4, 6, len(turn))
        points = distance[:, None] * np.stack([np.cos(turn), np.sin(turn), slope], -1)
        rows = np.column_stack([points, rng.uniform(0, 1, len(turn))]).astype("<f4")
        rows.tofile(tmp_path / "turns" / "velodyne" / f"{index:06d}.bin")
    return tmp_path / "turns"


def test_a_lidars_scan_without_intensity_is_named_and_nothing_written(vtr, scans, tmp_path):
    file = scans / "velodyne" / "000001.bin"
    values = np.fromfile(file, "<f4").reshape(-1, 4)
    values[:, 3] = 0.0
    values.tofile(file)
    result = vtr("odometry", scans, "--pipeline", "lidar", "-o", tmp_path / "poses.txt")
    assert result.code == 1
    assert "scan 1" in result.sentence
    assert "intensity" in result.sentence
    assert not (tmp_path / "poses.txt").exists()


def test_a_truncated_scan_is_named(vtr, scans):
    file = scans / "velodyne" / "000001.bin"
    file.write_bytes(file.read_bytes()[:-3])
    assert "000001.bin is truncated" in vtr("odometry", scans).sentence


def test_the_pipeline_follows_from_the_recording(vtr, scans, recording):
    assert json.loads(vtr("odometry", scans, "--json").out)["pipeline"] == "lidar"
    assert json.loads(vtr("odometry", recording, "--json").out)["pipeline"] == "stereo"
    assert "no scans" in vtr("odometry", recording, "--pipeline", "lidar").sentence


def test_lidar_odometry_says_that_its_truth_is_a_pseudo_truth(vtr, data_dir, tmp_path):
    files = ("--frames", ":10", "-o", tmp_path / "poses.txt", "--json")
    result = vtr("odometry", data_dir / "lidar_kitti_street22", "--pipeline", "lidar", *files)
    figures = json.loads(result.out)
    assert result.code == 0
    assert np.loadtxt(tmp_path / "poses.txt").shape == (10, 12)
    assert figures["drift"]["against"] == "pseudo truth"
    assert figures["drift"]["end_point_percent"] < 3
    assert figures["drift"]["end_rotation_deg"] < 1
    assert figures["frames_per_second"] > 0
