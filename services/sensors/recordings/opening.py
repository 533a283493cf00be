"""Opens whatever is a recording, as a drive."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from services.sensors.recordings.images import RecordingError
from services.sensors.recordings.lidar import is_lidar_recording, open_lidar_recording
from services.sensors.recordings.mcap import is_mcap_recording, open_mcap
from services.sensors.recordings.ros import is_bag, open_bag
from services.sensors.recordings.ros.mapping import Wish
from services.sensors.recordings.stereo import open_recording
from services.sensors.recordings.timeline import LidarTimeline, StereoTimeline, Timeline

KINDS = "a folder of stereo pairs or lidar scans, an Ouster's .pcap, a ROS bag, or an MCAP of vtr record"


@dataclass(frozen=True, slots=True)
class Names:
    """What the sensors of a recording that has no names of ours are called in their topics."""

    camera: str = "front"
    lidar: str = "top"


def open_timeline(path: Path, wishes: list[Wish], names: Names) -> Timeline:
    """Open a recording of any kind; ``wishes`` are mappings of a bag's topics.

    Raises:
        RecordingError: one sentence that says what is wrong or missing, and what to do.
    """
    place = path.expanduser()
    if not place.exists():
        raise RecordingError(f"there is no file or folder {place}: check the recording's path")
    place = place.resolve()
    ours = is_mcap_recording(place)
    if is_bag(place) and not ours:
        return open_bag(place, wishes, names.camera, names.lidar)
    if wishes:
        raise RecordingError(f"{place} is no ROS bag: its topics are ours already, without --map")
    if ours:
        return open_mcap(place)
    if is_lidar_recording(place):
        return LidarTimeline(open_lidar_recording(place), names.lidar)
    if place.is_file():
        raise RecordingError(f"{place} is no recording: give {KINDS}")
    return StereoTimeline(open_recording(place), names.camera)
