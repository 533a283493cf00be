"""Recordings as the offline commands take them: opened, cut to a slice of their frames."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from cli.errors import CommandError
from services.sensors.recordings import (
    LidarRecording,
    StereoRecording,
    is_lidar_recording,
    open_lidar_recording,
    open_recording,
)
from services.sensors.recordings.mcap import is_mcap_recording
from services.sensors.recordings.opening import Names
from services.sensors.recordings.ros import is_bag
from services.sensors.recordings.timeline import LidarTimeline, StereoTimeline, Timeline

_SLICE = re.compile(r"^(?P<start>\d*):(?P<stop>\d*)(?::(?P<step>\d*))?$")


def open_frames(path: Path, frames: str | None, option: str) -> StereoRecording:
    """The recording in a folder, or those of its frames that ``frames`` (``start:stop:step``) chooses.

    Raises:
        RecordingError: the folder is no recording that can be read.
        CommandError: ``frames`` is no slice, or chooses fewer than two frames.
    """
    recording = open_recording(path)
    if frames is None:
        return recording
    chosen = parse_slice(frames, option)
    part = replace(
        recording,
        stamps_ns=recording.stamps_ns[chosen],
        poses_truth=None if recording.poses_truth is None else recording.poses_truth[chosen],
        files_left=recording.files_left[chosen],
        files_right=recording.files_right[chosen],
    )
    _check_left(frames, len(part), len(recording), option)
    return part


def open_lidar_frames(path: Path, frames: str | None, option: str) -> LidarRecording:
    """As :func:`open_frames`, for a recording of a lidar."""
    recording = open_lidar_recording(path)
    if frames is None:
        return recording
    part = recording.select(parse_slice(frames, option))
    _check_left(frames, len(part), len(recording), option)
    return part


def open_slice(path: Path, frames: str, option: str, names: Names) -> Timeline:
    """Some frames of a folder as a drive.

    Raises:
        RecordingError: the folder is no recording that can be read.
        CommandError: ``frames`` is no slice or chooses fewer than two frames, or the recording is none of frames.
    """
    if is_bag(path) or is_mcap_recording(path):
        raise CommandError(
            f"{option} chooses of a folder's frames: of a bag or an MCAP choose by --start and --duration"
        )
    if is_lidar_recording(path):
        return LidarTimeline(open_lidar_frames(path, frames, option), names.lidar)
    return StereoTimeline(open_frames(path, frames, option), names.camera)


def _check_left(frames: str, left: int, of: int, option: str) -> None:
    if left < 2:
        raise CommandError(f"{option}: '{frames}' leaves {left} of the {of} frames: choose two or more")


def parse_slice(text: str, option: str) -> slice:
    """The slice written as Python does, without negative numbers: ``0::2`` are the even frames.

    Raises:
        CommandError: the text is no such slice.
    """
    match = _SLICE.match(text)
    if match is None or match["step"] == "0":
        raise CommandError(f"{option}: '{text}' chooses no frames: write start:stop:step, as 0::2 for the even ones")
    start, stop, step = (int(part) if part else None for part in (match["start"], match["stop"], match["step"]))
    return slice(start, stop, step)
