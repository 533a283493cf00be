"""A drive for the mounting as its sensors tell it: from a recording, or from the bus while it goes on."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cli.errors import CommandError
from common import topics, wire
from common.bus import Bus
from common.bus.tap import Tap
from common.camera import StereoCamera
from common.errors import MalformedMessage
from common.messages import StereoFrame, WheelOdometry
from services.estimator.stereo.odometry import StereoOdometry
from services.estimator.stereo.settings import StereoSettings
from services.estimator.stereo.warm_up import warm_up
from services.sensors.calibration.drive import Drive, Seen, join
from services.sensors.calibration.wheels import WheelLog
from services.sensors.recordings.timeline import Timeline

_JUDGED_S = 1.0
_POLL_S = 0.05
_SILENT_S = 15.0

OnFrame = Callable[[], None]
IsEnough = Callable[["Watcher"], bool]


@dataclass(slots=True)
class Watcher:
    """Sees a drive: odometry of its stereo frames, and the wheels' reports."""

    settings: StereoSettings
    frames: int = 0
    seen: list[Seen] = field(default_factory=list)
    reports: list[tuple[int, float, float]] = field(default_factory=list)
    _camera: StereoCamera | None = None
    _odometry: StereoOdometry | None = None
    _last: int | None = None
    _known: int | None = None
    _T_known_live: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    def frame(self, message: StereoFrame) -> None:
        """Takes a frame; one that is not newer than the last is left out."""
        if self._last is not None and message.stamp <= self._last:
            return
        odometry = self._odometry or self._open(message)
        result = odometry.process(message.left, message.right, message.stamp)
        self._T_known_live = self._T_known_live @ result.T_previous_live.T
        if result.success and self._known is not None:
            self.seen.append(Seen(self._known, message.stamp, self._T_known_live))
        # What a frame that failed was predicted to be is corrected by the next one, if that is matched with the same
        # keyframe; where the frame that failed is the new keyframe, nothing is.
        if result.success or result.is_keyframe:
            self._known, self._T_known_live = message.stamp, np.eye(4)
        self.frames, self._last = self.frames + 1, message.stamp

    def wheels(self, message: WheelOdometry) -> None:
        """Takes a report of the wheels."""
        self.reports.append((message.stamp, message.v, message.w))

    def drive(self) -> Drive:
        """The drive so far.

        Raises:
            CalibrationError: camera and wheels have too little in common.
        """
        return join(self.seen, self.frames, WheelLog.of(self.reports))

    def _open(self, first: StereoFrame) -> StereoOdometry:
        camera = first.camera.camera()
        warm_up(camera, self.settings)
        self._odometry = StereoOdometry(camera, self.settings)
        return self._odometry


def watch_recording(
    recording: Timeline, watcher: Watcher, name: str, span: tuple[float, float | None], on_frame: OnFrame
) -> None:
    """Takes the frames of the camera ``name`` and the wheels' reports of a recording.

    ``span`` is where it begins and how long it is, seconds; None is up to the end.

    Raises:
        CommandError: it has not both.
        RecordingError: it cannot be read.
    """
    frames = topics.STEREO.key.format(name=name)
    for key in (frames, topics.WHEEL_ODOMETRY.key):
        if key not in recording.counts:
            has = ", ".join(recording.counts) or "nothing of a sensor"
            raise CommandError(f"{recording.name} has no {key}: it has {has}")
    start = recording.start_ns + round(1e9 * span[0])
    end = None if span[1] is None else start + round(1e9 * span[1])
    for entry in recording.entries(start, end):
        if entry.key == frames and isinstance(entry.message, StereoFrame):
            watcher.frame(entry.message)
            on_frame()
        elif isinstance(entry.message, WheelOdometry):
            watcher.wheels(entry.message)


def watch_bus(bus: Bus, watcher: Watcher, name: str, seconds: float, is_enough: IsEnough) -> None:
    """Takes what a live robot's sensors say until ``is_enough``, asked once a second; or the time is over, or ctrl-C.

    Raises:
        CommandError: nothing comes.
    """
    frames, wheels = bus.subscribe(topics.STEREO, name), bus.tap([(topics.WHEEL_ODOMETRY, "*")])
    began = judged = time.monotonic()
    with contextlib.suppress(KeyboardInterrupt):
        while (now := time.monotonic()) < began + seconds:
            received = frames.wait(_POLL_S)
            if received is not None:
                watcher.frame(received.message)
            _take(wheels, watcher)
            if now >= began + _SILENT_S:
                _check_heard(watcher, name)
            if now >= judged + _JUDGED_S:
                judged = now
                if is_enough(watcher):
                    return


def _take(wheels: Tap, watcher: Watcher) -> None:
    while (sample := wheels.take()) is not None:
        with contextlib.suppress(MalformedMessage):
            watcher.wheels(wire.decode(WheelOdometry, sample.payload))


def _check_heard(watcher: Watcher, name: str) -> None:
    for heard, key in ((watcher.frames, f"sensor/stereo/{name}"), (watcher.reports, topics.WHEEL_ODOMETRY.key)):
        if not heard:
            raise CommandError(f"nothing came on {key} in {_SILENT_S:g} s: vtr doctor says who should publish it")
