"""``vtr calibrate``: a folder or devices in, the file, the report and the figures out, one sentence otherwise."""

import json
import struct
import tomllib

import cv2
import numpy as np
import pytest

from cli import robot
from services.sensors.calibration import file
from services.sensors.calibration.simulation import BoardRenderer, simulated_poses, simulated_rig
from services.sensors.settings import Settings
from tests.services.sensors.video import write_video

BOARD = ("--board", "7x5", "--square", "0.04", "--marker", "0.03")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Ten pairs of a board and one left image too many."""
    root = tmp_path_factory.mktemp("pairs")
    for side in ("left", "right"):
        (root / side).mkdir()
    for name, left, right in BoardRenderer(simulated_rig()).pairs(10):
        cv2.imwrite(str(root / "left" / f"{name}.png"), left)
        cv2.imwrite(str(root / "right" / f"{name}.png"), right)
    cv2.imwrite(str(root / "left" / "extra.png"), left)
    return root


def test_a_folder_becomes_a_calibration_and_a_report(vtr, folder, tmp_path):
    result = vtr("calibrate", folder, *BOARD, "-o", "c.toml", "--report", "report/new", "--json")
    assert result.code == 0, result.err
    figures = json.loads(result.out)
    assert figures["pairs_used"] == 10
    assert figures["reprojection_px"] < 0.3
    assert figures["unpaired"] == ["left extra"]
    assert figures["left"]["fx"] == pytest.approx(simulated_rig().left.fx, rel=3e-3)
    assert figures["baseline_m"] == pytest.approx(simulated_rig().baseline, rel=2e-3)
    stored = file.load(tmp_path / "c.toml")
    assert stored.rig.baseline == pytest.approx(figures["baseline_m"], abs=1e-6)
    written = {path.name for path in (tmp_path / "report" / "new").iterdir()}
    assert written == {"report.json", "residuals.png", "coverage.png", "rectified.png"}
    assert cv2.imread(str(tmp_path / "report" / "new" / "rectified.png")).shape == (320, 960, 3)


def test_a_new_calibration_keeps_the_mounting(vtr, folder, tmp_path):
    mounting = file.MountingTable(position=(0.3, 0.0, 0.7), pitch=0.2)
    (tmp_path / "calibration.toml").write_text(file.text(simulated_rig(), mounting), encoding="utf-8")
    out = vtr("calibrate", folder, *BOARD).out
    assert "10 pairs used" in out
    assert "no partner: left extra" in out
    assert "where is the camera" not in out
    assert file.load(tmp_path / "calibration.toml").mounting == mounting


def test_the_robot_uses_it_where_it_is_named(vtr, folder, tmp_path, write_config):
    """Its file gets the driver, the calibration and nothing else; a wrong one is refused before anything is written."""
    config = write_config("[sensors] # what it sees with\nframe_rate = 12.0 # enough\n")
    result = vtr("calibrate", folder, *BOARD, "-o", "cameras/c.toml", "--config", config)
    assert "no folder" in result.sentence
    assert "driver" not in config.read_text()
    (tmp_path / "cameras").mkdir()
    assert "names it" in vtr("calibrate", folder, *BOARD, "-o", "cameras/c.toml", "--config", config).out
    text = config.read_text()
    assert "frame_rate = 12.0 # enough" in text
    assert "[sensors] # what it sees with" in text
    settings = robot.load(config).settings("sensors", Settings)
    assert (settings.driver, str(settings.calibration), settings.frame_rate) == ("cameras", "cameras/c.toml", 12.0)
    robot.check(robot.load(config))
    config.write_text(text.replace("frame_rate", "frame_rat"))
    (tmp_path / "cameras" / "c.toml").unlink()
    assert "frame_rat" in vtr("calibrate", folder, *BOARD, "-o", "cameras/c.toml", "--config", config).sentence
    assert not (tmp_path / "cameras" / "c.toml").exists()


def test_what_is_no_calibration_is_not_overwritten(vtr, folder, tmp_path):
    (tmp_path / "robot.toml").write_text('[robot]\nname = "r"\n', encoding="utf-8")
    assert "robot.toml" in vtr("calibrate", folder, *BOARD, "-o", "robot.toml").sentence
    assert "name" in tomllib.loads((tmp_path / "robot.toml").read_text())["robot"]


def test_a_bad_set_is_refused_and_nothing_is_written(vtr, folder, tmp_path):
    assert "7x5" in vtr("calibrate", folder, "--board", "5x7").sentence
    assert "6X6_250" in vtr("calibrate", folder, "--dictionary", "DICT_6X6_250").sentence
    assert not (tmp_path / "calibration.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "give the folder"),
        (("nowhere",), "nowhere"),
        ((".", "--board", "7"), "--board"),
        ((".", "--board", "axb"), "--board"),
        ((".", "--square", "0.02"), "do not fit"),
        ((".", "--dictionary", "7X7"), "7X7"),
        ((".",), "no pairs"),
        ((".", "-o", "no/where.toml"), "no folder"),
        (("--print-board", "board.pdf"), "board.pdf"),
        (("--print-board", "no/board.png"), "no folder"),
        ((".", "--device", "a", "--device", "b", "--device", "c"), "--device"),
        (("new", "--device", "nowhere.avi"), "nowhere.avi"),
    ],
)
def test_what_cannot_be_is_one_sentence(vtr, arguments, words):
    result = vtr("calibrate", *arguments)
    assert result.code == 1
    assert words in result.sentence


def test_the_board_is_drawn_at_its_true_size(vtr, tmp_path):
    figures = json.loads(vtr("calibrate", "--print-board", "board.png", "--board", "6x4", "--json").out)
    assert (figures["width_mm"], figures["height_mm"]) == (240, 160)
    content = (tmp_path / "board.png").read_bytes()
    at = content.index(b"pHYs") + 4
    across, down, unit = struct.unpack(">IIB", content[at : at + 9])
    image = cv2.imread(str(tmp_path / "board.png"), cv2.IMREAD_GRAYSCALE)
    inside = np.argwhere(image[: int(0.9 * image.shape[0])] < 128)
    size = (inside.max(axis=0) - inside.min(axis=0) + 1) / [down, across]
    assert unit == 1
    assert size == pytest.approx([0.16, 0.24], abs=2e-4)


def test_pairs_are_taken_from_a_device(vtr, tmp_path):
    """A board is held still for three frames in each of ten poses, and carried about between them."""
    renderer, rng, frames = BoardRenderer(simulated_rig()), np.random.default_rng(1), []
    for T in simulated_poses(10, rng):
        frames += [np.hstack(renderer.pair(T, rng)) for _ in range(3)]
        frames.append(np.hstack(renderer.pair(T, rng, blur=4.0)))
    write_video(tmp_path / "both.avi", frames, 100.0)
    result = vtr("calibrate", "taken", *BOARD, "--device", tmp_path / "both.avi", "--views", "9", "--json")
    assert result.code == 0, result.err
    figures = json.loads(result.out)
    assert figures["pairs_used"] == 9
    assert figures["reprojection_px"] < 0.3
    assert len(list((tmp_path / "taken" / "right").iterdir())) == 9
    again = vtr("calibrate", "taken", *BOARD, "--device", tmp_path / "both.avi")
    assert "holds images already" in again.sentence
