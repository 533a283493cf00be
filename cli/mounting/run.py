"""What ``vtr calibrate mounting`` does: a drive in; the mounting, its report, and the calibration that has it out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cli import client, robot
from cli.errors import CommandError
from cli.mounting.watching import Watcher, watch_bus, watch_recording
from cli.output import emit, progress
from common.config import RobotConfig
from services.estimator.settings import Settings as EstimatorSettings
from services.sensors.calibration import file
from services.sensors.calibration.drive import Drive
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.file_edit import set_mounting
from services.sensors.calibration.mounting import Course, mount
from services.sensors.calibration.mounting_report import figures, write_report
from services.sensors.recordings.opening import Names, open_timeline
from services.sensors.recordings.ros import parse_map
from services.sensors.settings import Settings as SensorSettings

ENOUGH_RAD = float(np.radians(690.0))
"""A live drive is over by itself once it has turned by this to either side: two laps of an eight, as people drive."""

Hint = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Source:
    """Where the drive comes from.

    Attributes:
        data: a recording; None is the live robot.
        mapping: a bag's topics, as ``vtr play`` takes them.
        name: of the stereo camera; None is the one that the robot localizes by.
        start, duration: the part of a recording, or how long a live drive may last, seconds.
    """

    data: Path | None
    mapping: list[str]
    name: str | None
    start: float
    duration: float | None


def find_robot(path: Path | None, *, needed: bool) -> RobotConfig | None:
    """The robot's configuration; None where none is named, none is here, and none is ``needed``.

    Raises:
        CommandError: it is needed.
        ConfigurationError: it cannot be used.
    """
    if path is None and not needed and not robot.DEFAULT.is_file():
        return None
    return robot.load(path)


def find_output(output: Path | None, configuration: RobotConfig | None) -> Path | None:
    """The calibration file that gets the mounting: the one named, else the robot's own, None where it has none.

    Raises:
        ConfigurationError: it is none.
    """
    if output is None and configuration is not None:
        named = configuration.settings("sensors", SensorSettings).calibration
        output = None if named is None else configuration.path.absolute().parent / named.expanduser()
    if output is not None:
        file.load(output)
    return output


def find_height(height: float | None, output: Path | None) -> float:
    """The camera's height that was given, else the one that the calibration has already.

    Raises:
        CommandError: there is neither.
    """
    known = 0.0 if output is None else file.load(output).mounting.position[2]
    if height is None and known == 0.0:
        raise CommandError(
            "give the left camera's height above the ground by --height METRES: driving on a plane does not tell it"
        )
    return known if height is None else height


def run(
    source: Source,
    configuration: RobotConfig | None,
    output: Path | None,
    height: float,
    report: Path | None,
    *,
    as_json: bool,
) -> None:
    """Computes the mounting from a drive, writes it and its report, and prints the figures."""
    drive = _watch(source, configuration, height)
    found = mount(drive.camera_motions, drive.wheel_motions, height)
    if report is not None:
        write_report(report, found, drive)
    table = file.MountingTable.of(found.T_vehicle_camera)
    if output is not None:
        set_mounting(output, table)
    data = figures(found, drive)
    data |= {
        "output": None if output is None else str(output),
        "report": None if report is None else str(report),
    }
    emit(data, _text(data, table), as_json=as_json)


def _watch(source: Source, configuration: RobotConfig | None, height: float) -> Drive:
    settings = EstimatorSettings() if configuration is None else configuration.settings("estimator", EstimatorSettings)
    name, watcher = source.name or settings.camera, Watcher(settings.stereo)
    if source.data is not None:
        recording = open_timeline(source.data, parse_map(source.mapping), Names(camera=name))
        with progress() as display:
            task = display.add_task(recording.name, total=recording.counts.get(f"sensor/stereo/{name}"))
            span = source.start, source.duration
            watch_recording(recording, watcher, name, span, lambda: display.advance(task))
    elif configuration is not None:
        with client.connect(configuration) as bus, progress() as display:
            task = display.add_task("waiting for frames and wheels", total=None)

            def is_enough(seen: Watcher) -> bool:
                hint, enough = judge(seen, height)
                display.update(task, description=hint, completed=seen.frames)
                return enough

            watch_bus(bus, watcher, name, source.duration or 600.0, is_enough)
    return watcher.drive()


def judge(watcher: Watcher, height: float) -> tuple[str, bool]:
    """What a drive tells so far, or what it lacks, in words; and whether it is enough."""
    try:
        drive = watcher.drive()
        course = Course.of(drive.wheel_motions)
        found = mount(drive.camera_motions, drive.wheel_motions, height)
    except CalibrationError as error:
        return str(error), False
    known = f"place known to {100 * max(found.place_sigma):.1f} cm, yaw to {np.degrees(found.yaw_sigma):.2f} degrees"
    return f"{course}: {known}", min(course.left, course.right) >= ENOUGH_RAD


def _text(data: dict[str, Any], table: file.MountingTable) -> str:
    """The figures in sentences."""
    (x, y, z), sigma = table.position, [100 * value for value in data["position_sigma_m"]]
    driven = f"{data['length_m']:.1f} m, {data['left_deg']:.0f}° to the left, {data['right_deg']:.0f}° to the right"
    place = f"{x:.3f} m (± {sigma[0]:.1f} cm) forward, {y:.3f} m (± {sigma[1]:.1f} cm) left, {z:.3f} m up as given"
    leaning = f"roll {data['roll_deg']:.2f} and pitch {data['pitch_deg']:.2f} (± {data['roll_pitch_sigma_deg']:.2f})"
    wheels = f"distances times {data['wheel_distance_scale']:.3f}, turns times {data['wheel_turn_scale']:.3f}"
    late, slip = f"stamps {1e3 * data['wheel_delay_s']:+.0f} ms", f"slip on {100 * data['slipped']:.0f} %"
    lines = [
        f"driven: {driven}; {data['frames_used']} of {data['frames']} frames used",
        f"camera: {place} of the vehicle's origin",
        f"{leaning}, yaw {data['yaw_deg']:.2f} degrees (± {data['yaw_sigma_deg']:.2f})",
        f"wheels: {wheels}, {late}, {slip} of the way",
        *(f"could be better: {warning}" for warning in data["warnings"]),
    ]
    if data["report"] is not None:
        lines.append(f"report in {data['report']}")
    if data["output"] is not None:
        return "\n".join([*lines, f"written: {data['output']}; the robot uses it from its next start on"])
    lines += ["no calibration was named (-o) to write it into:", "[calibration.mounting]"]
    lines.append(f"position = [{x:.4f}, {y:.4f}, {z:.4f}]")
    return "\n".join(lines + [f"{name} = {getattr(table, name):.5f}" for name in ("roll", "pitch", "yaw")])
