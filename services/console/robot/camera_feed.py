"""The camera's pictures, heard only while somebody looks."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common import topics
from common.bus import Bus, Subscription
from common.messages import CameraFrame, LidarScan, Matches, StereoFrame
from services.console.channel import Channel
from services.console.robot.models import camera
from services.console.settings import Settings

_TOPICS = {"stereo": topics.STEREO, "bearing": topics.CAMERA, "lidar": topics.LIDAR}
_KEPT = 6
_PATIENCE_S = 0.4
"""So long a picture waits for the features that were matched in it."""

Image = NDArray[np.uint8]


class CameraFeed:
    """Puts a picture into the channel a few times a second.

    The frame is shown in which the newest features were matched, so that they lie where they belong; where none are
    matched, the newest one.
    """

    def __init__(self, bus: Bus, sensor: str, channel: Channel, settings: Settings) -> None:
        self._bus = bus
        self._topic = _TOPICS[sensor]
        self._channel = channel
        self._quality = settings.image_quality
        self._period = 1.0 / settings.image_rate
        self._frames: Subscription[Any] | None = None
        self._matches: Subscription[Matches] | None = None
        self._recent: deque[tuple[int, Image]] = deque(maxlen=_KEPT)
        self._shown = 0
        self._due = 0.0
        self._matched = 0.0

    def update(self, now: float) -> None:
        """Called with the page; hears nothing, and costs nothing, while nobody watches."""
        if not self._channel.watchers:
            self._close()
            return
        if self._frames is None or self._matches is None:
            self._frames = self._bus.subscribe(self._topic)
            self._matches = self._bus.subscribe(topics.MATCHES)
        while received := self._frames.poll():
            self._recent.append((received.message.stamp, _image(received.message)))
        if now < self._due:
            return
        matches = self._matches.last()
        if matches is not None and now - matches.arrival < _PATIENCE_S:
            image = dict(self._recent).get(matches.message.stamp)
            if image is not None:
                self._show(now, matches.message.stamp, image, matches.message)
        elif self._recent:
            self._show(now, *self._recent[-1], None)

    def _show(self, now: float, stamp: int, image: Image, matches: Matches | None) -> None:
        if stamp == self._shown:
            return
        self._shown, self._due = stamp, max(self._due + self._period, now)
        data, scale = camera.jpeg(image, self._quality)
        pixels = None if matches is None else matches.pixels
        if pixels is not None and self._topic is topics.LIDAR:
            pixels = camera.on_lidar_image(pixels)
        about = camera.header(stamp, image, scale, pixels)
        about["stream"] = "" if matches is None else matches.stream
        about["success"] = matches is not None and matches.success
        self._channel.show("camera", data, about)

    def _close(self) -> None:
        for subscription in (self._frames, self._matches):
            if subscription is not None:
                subscription.close()
        self._frames = self._matches = None
        self._recent.clear()


def _image(frame: StereoFrame | CameraFrame | LidarScan) -> Image:
    if isinstance(frame, StereoFrame):
        return frame.left
    return frame.image if isinstance(frame, CameraFrame) else camera.lidar_image(frame)
