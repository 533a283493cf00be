"""What ``vtr calibrate`` does: pairs of images in, taken now if asked for; the calibration and its report out."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import cv2

from cli import robot
from cli.errors import CommandError
from cli.output import emit, progress
from cli.views.offline import check_writable, write
from common.errors import ConfigurationError
from services.sensors.calibration import file
from services.sensors.calibration.board import FAMILIES, Board, Image
from services.sensors.calibration.calibrate import Calibration, calibrate
from services.sensors.calibration.choosing import PoseChooser
from services.sensors.calibration.detection import as_grey
from services.sensors.calibration.file_edit import change
from services.sensors.calibration.pairs import find_pairs
from services.sensors.calibration.report import figures, write_report
from services.sensors.calibration.views import MIN_VIEWS
from services.sensors.capture import Format, StereoCapture


@dataclass(frozen=True, slots=True)
class UsedBy:
    """The robot's TOML file that is to name the calibration, and the devices that its images came from, if any."""

    config: Path
    devices: tuple[str, ...]

    def name(self, calibration: Path) -> None:
        """Has the robot's driver of cameras use the calibration.

        Raises:
            ConfigurationError: the file would not be a right one, or cannot be written.
        """
        robot_folder = self.config.expanduser().resolve().parent
        place = os.path.relpath(calibration.expanduser().resolve(), robot_folder)
        values: dict[str, Any] = {"driver": "cameras", "calibration": place}
        change(self.config.expanduser(), ("sensors",), values, _check)
        if self.devices:
            devices = [int(device) if device.isdecimal() else device for device in self.devices]
            change(self.config.expanduser(), ("sensors", "cameras"), {"devices": devices}, _check)


def find_robot(path: Path, devices: Sequence[str]) -> UsedBy:
    """The robot that is to use a calibration made from devices, or from a folder.

    Raises:
        ConfigurationError: its file cannot be read or used.
    """
    _check(path.expanduser())
    return UsedBy(path, tuple(devices))


def _check(path: Path) -> None:
    robot.check(robot.load(path))


def make_board(squares: tuple[int, int], square: float, marker: float, dictionary: str | None) -> Board:
    """The board that was named; without a dictionary, with the smallest of the 5X5 ones that has enough markers."""
    if dictionary is None:
        sizes = (100, 250, 1000)
        needed = squares[0] * squares[1] // 2
        dictionary = f"{FAMILIES[1]}_{next((s for s in sizes if s >= needed), sizes[-1])}"
    return Board(*squares, square, marker, dictionary.strip().removeprefix("DICT_"))


def run(
    folder: Path,
    board: Board,
    output: Path,
    report: Path | None,
    *,
    any_dictionary: bool,
    coefficients: Literal[5, 8],
    side_by_side: bool,
    used_by: UsedBy | None,
    as_json: bool,
) -> None:
    """Calibrates from a folder, writes the file and the report, and prints the figures."""
    check_writable(output)
    mounting = _mounting(output)
    found = find_pairs(folder, side_by_side=side_by_side)
    with progress() as display:
        task = display.add_task("images", total=2 * len(found))
        pairs = []
        for pair in found:
            pairs.append(pair)
            display.advance(task)
        result = calibrate(
            pairs,
            board,
            any_dictionary=any_dictionary,
            coefficients=coefficients,
            progress=lambda: display.advance(task),
        )
    if report is not None:
        first = result.found.problem.views[0].name
        write_report(report, result, next(pair for pair in pairs if pair[0] == first))
    data = figures(result)
    write(output, file.text(result.found.solution.rig, mounting, _remarks(data)))
    if used_by is not None:
        used_by.name(output)
    lonely = list(found.lonely)
    data |= {"unpaired": lonely, "output": str(output), "report": None if report is None else str(report)}
    data["robot"] = None if used_by is None else str(used_by.config)
    emit(data, _text(data, result, measured=mounting != file.MountingTable()), as_json=as_json)


def _mounting(output: Path) -> file.MountingTable:
    """The mounting that the file at ``output`` has already: a new calibration does not move the camera.

    Raises:
        CommandError: the file is there, and is no calibration.
    """
    if not output.exists():
        return file.MountingTable()
    try:
        return file.load(output).mounting
    except ConfigurationError as error:
        raise CommandError(f"{output} is there already and no calibration ({error}): give another --output") from None


def _remarks(data: dict[str, Any]) -> tuple[str, ...]:
    return (
        f"Made by vtr calibrate on {datetime.now(UTC):%Y-%m-%d} from {data['pairs_used']} pairs of {data['board']}.",
        f"Reprojection {data['reprojection_px']:.3f} px; {_known(data)}.",
        'A robot uses it with [sensors] driver = "cameras" and calibration = "the path of this file".',
    )


def _known(data: dict[str, Any]) -> str:
    """How exactly, as standard deviations."""
    focal = max(float(data[side]["focal_sigma_percent"]) for side in ("left", "right"))
    return f"focal lengths known to {focal:.2f} %, baseline to {data['baseline_sigma_percent']:.2f} %"


def _text(data: dict[str, Any], result: Calibration, *, measured: bool) -> str:
    rig = result.found.solution.rig
    lines = [
        f"{data['pairs_used']} pairs used, {len(data['dropped'])} dropped; board {data['board']}",
        f"reprojection {data['reprojection_px']:.3f} px, rows after rectification {data['vertical_px']:.3f} px apart",
        f"focal lengths {rig.left.fx:.2f} and {rig.right.fx:.2f} px, baseline {1e3 * rig.baseline:.2f} mm",
        _known(data),
    ]
    lines += [f"dropped {name}: {reason}" for name, reason in data["dropped"].items()]
    lines += [f"no partner: {name}" for name in data["unpaired"]]
    lines += [f"could be better: {warning}" for warning in data["warnings"]]
    lines.append(f"written: {data['output']}" + ("" if data["report"] is None else f", report in {data['report']}"))
    if data["robot"] is not None:
        lines.append(f"{data['robot']} names it: the robot uses it from its next start on")
    if not measured:
        lines.append("next: where is the camera on the vehicle? vtr calibrate mounting, or a tape measure")
    return "\n".join(lines)


def capture_into(
    folder: Path, devices: Sequence[str], board: Board, views: int, seconds: float, *, any_dictionary: bool
) -> None:
    """Takes pairs of a still board in new poses from devices, into ``left/`` and ``right/`` of a folder without any.

    Raises:
        CommandError: the folder holds images, or too few poses were shown in time.
        CaptureError: a device cannot be opened, or fails.
    """
    if len(devices) > 2:
        raise CommandError("--device: give the left and the right camera, or the one that delivers both")
    sides = [folder / "left", folder / "right"]
    if any(side.is_dir() and any(side.iterdir()) for side in sides):
        raise CommandError(f"{folder} holds images already: give an empty folder, or leave --device out to use them")
    chooser, end = PoseChooser(board, any_dictionary=any_dictionary), time.monotonic() + seconds
    hint = "show the board to both cameras"
    with StereoCapture(devices, Format()) as capture, progress() as display:
        task = display.add_task("", total=views)
        while len(chooser.kept) < views and time.monotonic() < end:
            capture.grab()
            pair = capture.retrieve()
            images = as_grey(pair.left), as_grey(pair.right)
            hint = chooser.consider(*images) or "kept: now another place, distance or tilt"
            display.update(task, description=hint, completed=len(chooser.kept))
            if hint.startswith("kept"):
                _keep(sides, f"{len(chooser.kept):03d}.png", images)
    if len(chooser.kept) < MIN_VIEWS:
        raise CommandError(
            f"only {len(chooser.kept)} poses were taken in {seconds:g} s, {MIN_VIEWS} are needed; the last hint: {hint}"
        )


def _keep(sides: Sequence[Path], name: str, images: Sequence[Image]) -> None:
    """Saves a pair.

    Raises:
        CommandError: it cannot be written.
    """
    for side, image in zip(sides, images, strict=True):
        try:
            side.mkdir(parents=True, exist_ok=True)
            (side / name).write_bytes(cv2.imencode(".png", image)[1].tobytes())
        except OSError as error:
            raise CommandError(f"cannot write {side / name}: {error.strerror}") from None
