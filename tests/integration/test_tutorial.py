"""The tutorial's commands, to the letter, on the synthetic robot; its program and its tables are the page's own."""

import os
import re
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass

import cv2
import pytest

from cli import robot as robot_checks
from cli.processes import ROBOT
from common import config, topics
from common.messages import VelocityCommand, now_ns
from services.sensors.calibration import file as calibration_file
from services.sensors.calibration.simulation import BoardRenderer, simulated_rig
from tests.processes import ROOT, Robot, eventually, free_port
from tests.terminal import Terminal

PAGE = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
_BLOCK = re.compile(
    r"(?P<left_out><!-- not run here: (?P<why>[^>]+) -->\n)?```(?P<kind>\w+)[^\n]*\n(?P<text>.*?)```", re.DOTALL
)
_DRIVEN_S = 6.0
_DEADLINE_S = 90.0


@dataclass(frozen=True)
class Block:
    kind: str
    text: str
    why_not: str


BLOCKS = [Block(found["kind"], found["text"], found["why"] or "") for found in _BLOCK.finditer(PAGE)]


def only(kind, containing):
    return next(block.text for block in BLOCKS if block.kind == kind and containing in block.text)


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder as the tutorial's reader has it: the examples, a camera's pairs of a board, and ``vtr``."""
    folder = tmp_path_factory.mktemp("tutorial")
    shutil.copytree(ROOT / "deploy", folder / "deploy")
    for side in ("left", "right"):
        (folder / "pairs" / side).mkdir(parents=True)
    for name, left, right in BoardRenderer(simulated_rig()).pairs(10):
        cv2.imwrite(str(folder / "pairs" / "left" / f"{name}.png"), left)
        cv2.imwrite(str(folder / "pairs" / "right" / f"{name}.png"), right)
    vtr = folder / "bin" / "vtr"
    vtr.parent.mkdir()
    vtr.write_text(f'#!/bin/sh\nexec {sys.executable} -m cli "$@"\n', encoding="utf-8")
    vtr.chmod(0o755)
    return folder


def environment(folder):
    kept = {name: value for name, value in os.environ.items() if name not in {"VTR_CONFIG", "XDG_STATE_HOME"}}
    return kept | {"HOME": str(folder), "PATH": f"{folder / 'bin'}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}


def run(folder, line):
    done = subprocess.run(
        ["bash", "-c", line], cwd=folder, env=environment(folder), capture_output=True, text=True,
        timeout=_DEADLINE_S, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    return done.stdout


def use_free_ports(folder):
    """What else runs on this machine must not be met."""
    path = folder / "robot.toml"
    text = path.read_text(encoding="utf-8")
    for default in ('# endpoint = "tcp/127.0.0.1:7447"', "# port = 8180"):
        assert text.count(default) == 1
        text = text.replace(default, re.sub(r"\d{4,}", str(free_port()), default.removeprefix("# ")))
    path.write_text(text, encoding="utf-8")


def drive(folder, line):
    """Types the keys that the tutorial names."""
    with Terminal(*line.split()[1:], cwd=folder, HOME=str(folder)) as terminal:
        terminal.shows("q end")
        terminal.hold("w", _DRIVEN_S)
        time.sleep(1.0)  # the key is released, and the robot comes to rest
        terminal.type("q")
        assert terminal.ends() == 0


def test_what_is_left_out_is_what_cannot_be_here():
    left_out = {line.split()[0] for block in BLOCKS if block.why_not for line in block.text.splitlines()}
    assert left_out <= {"make", ".", "vtr"}
    assert all("--device" in block.text or "make" in block.text for block in BLOCKS if block.why_not)


@pytest.mark.long
def test_the_commands_lead_from_nothing_to_a_repeat(desk):
    said = {}
    try:
        for block in BLOCKS:
            if block.kind != "sh" or block.why_not:
                continue
            for line in block.text.splitlines():
                if line.startswith("vtr drive"):
                    drive(desk, line)
                    continue
                said[line] = run(desk, line)
                if line.startswith("cp "):
                    use_free_ports(desk)
    finally:
        subprocess.run(["vtr", "down"], cwd=desk, env=environment(desk), capture_output=True, check=False)
    assert said["vtr --version"].startswith("vtr ")
    assert (desk / "board.png").is_file()
    assert "10 pairs used" in said[next(line for line in said if line.startswith("vtr calibrate pairs"))]
    assert said["vtr ps"].count("running") == len(ROBOT)
    assert re.search(r"shed\s+gate", said["vtr maps ls"])
    assert "reached" in said["vtr repeat shed --wait"]
    assert "reached" in said["vtr repeat gate --wait"]
    assert "emergency stop" in said["vtr state"]


def test_the_tables_of_a_real_robot_are_right(desk, tmp_path):
    if not (desk / "calibration.toml").is_file():
        run(desk, next(line for line in PAGE.splitlines() if line.startswith("vtr calibrate pairs --board")))
    measured = (desk / "calibration.toml").read_text(encoding="utf-8").partition("[calibration.mounting]")[0]
    (tmp_path / "calibration.toml").write_text(measured + only("toml", "[calibration.mounting]"), encoding="utf-8")
    assert calibration_file.load(tmp_path / "calibration.toml").mounting.pitch == 0.14
    (tmp_path / "robot.toml").write_text(only("toml", 'driver = "cameras"'), encoding="utf-8")
    robot_checks.check(config.load(tmp_path / "robot.toml"))


def test_the_program_of_the_base_obeys_and_stops_and_tells_its_speed(tmp_path):
    (tmp_path / "base.py").write_text(only("python", "wheels.drive"), encoding="utf-8")
    (tmp_path / "wheels.py").write_text(
        "import pathlib\nlast = (0.0, 0.0)\ndef drive(v, w):\n    global last\n    last = (v, w)\n"
        "    pathlib.Path('driven').write_text(str(v))\ndef speed():\n    return last\n",
        encoding="utf-8",
    )
    with Robot(tmp_path) as robot:
        wheels = robot.bus("observer").subscribe(topics.WHEEL_ODOMETRY)
        safe = robot.act_as("safety").publisher(topics.SAFE)
        base = subprocess.Popen(
            [sys.executable, "base.py"], cwd=tmp_path, env=environment(tmp_path), stderr=subprocess.PIPE
        )
        try:

            def obeys():
                safe.put(VelocityCommand(stamp=now_ns(), v=0.4, w=0.1))
                last = wheels.last()
                return last is not None and (last.message.v, last.message.w) == (0.4, 0.1)

            eventually(obeys, "the wheels do what safety lets through")
            eventually(lambda: wheels.last().message.v == 0.0, "they stop when it falls silent")
            assert wheels.last().source.process == "base"
            assert base.poll() is None
        finally:
            base.kill()
            base.communicate()
