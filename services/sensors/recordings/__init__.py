"""Recorded drives, read from disk frame by frame. Nothing here knows a bus."""

from services.sensors.recordings.images import RecordingError
from services.sensors.recordings.lidar import LidarRecording, is_lidar_recording, open_lidar_recording
from services.sensors.recordings.stereo import StereoPair, StereoRecording, open_recording

__all__ = [
    "LidarRecording",
    "RecordingError",
    "StereoPair",
    "StereoRecording",
    "is_lidar_recording",
    "open_lidar_recording",
    "open_recording",
]
