"""The real recordings that benches measure on, where they are at hand."""

from __future__ import annotations

import os
from pathlib import Path

from services.sensors.recordings import StereoRecording, open_recording


def folder() -> Path:
    """Where recordings are: ``VTR_DATA``, or ``../shared/data`` beside the project."""
    return Path(os.environ.get("VTR_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


def kitti(name: str) -> StereoRecording | None:
    """A stereo recording of that name, None where it is not at hand."""
    found = folder() / name
    return open_recording(found) if found.is_dir() else None
