"""Recorded stereo drives, read from disk pair by pair. Nothing here knows a bus."""

from services.sensors.recordings.images import RecordingError
from services.sensors.recordings.stereo import StereoPair, StereoRecording, open_recording

__all__ = ["RecordingError", "StereoPair", "StereoRecording", "open_recording"]
