"""The cameras' side: a stereo pair as ``sensor/stereo/<name>``, or one camera as ``sensor/camera/<name>``."""

from __future__ import annotations

import threading
import time
from functools import partial
from typing import Any

import numpy as np

from common import topics
from common.messages import now_ns
from services.sensors.ros2 import types
from services.sensors.ros2.cameras import StereoPair, camera_frame
from services.sensors.ros2.errors import RosDataError
from services.sensors.ros2.graph import Arrived, RosSubscription
from services.sensors.ros2.link import Link, each
from services.sensors.ros2.pace import Pace
from services.sensors.ros2.pairs import Joiner, Pair, Side
from services.sensors.ros2.qos import SENSOR_DATA

_PATIENCE_S = 3.0
_SIDES: tuple[Side, Side] = ("left", "right")


def image_type(topic: str) -> str:
    """The type of a topic of images."""
    return types.COMPRESSED if topic.endswith("/compressed") else types.IMAGE


class Stereo:
    """Joins, rectifies and publishes a pair, in a thread of its own."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._wake = threading.Event()
        graph, settings = link.graph, link.settings
        names = (settings.inputs.left, settings.inputs.right)
        self._images = {
            side: graph.subscribe(name, image_type(name), SENSOR_DATA, self._wake)
            for side, name in zip(_SIDES, names, strict=True)
        }
        self._topics = (self._images["left"].topic, self._images["right"].topic)
        self._pair = self._calibrated()
        self._infos: dict[Side, RosSubscription] = {}
        if self._pair is None:
            self._infos = {
                side: graph.subscribe(name, types.CAMERA_INFO, SENSOR_DATA, self._wake)
                for side, name in zip(_SIDES, settings.inputs.infos, strict=True)
            }
        self._known: dict[Side, Any] = {}
        self._began = time.monotonic()
        self._joiner: Joiner[Any] = Joiner(round(settings.tolerance * 1e9))
        self._pace = Pace(link.sensors.frame_rate)
        self._pairs = link.service.bus.publisher(topics.STEREO, link.sensors.camera)
        self.steady = [*self._images.values(), *self._infos.values()]

    def run(self) -> None:
        """Publishes the newest pair until the service stops."""
        for _ in self._link.looks(self._wake):
            for side, subscription in self._infos.items():
                self._learn(side, subscription)
            pair = self._newest()
            if pair is not None and not self._link.silent and self._pace.lets(time.monotonic()):
                self._publish(pair)

    def _calibrated(self) -> StereoPair | None:
        calibration = self._link.calibration
        return None if calibration is None else StereoPair.by_calibration(calibration, self._topics)

    def _learn(self, side: Side, subscription: RosSubscription) -> None:
        """Takes the newest camera info of a side; another calibration than before makes another pair, if it can."""
        newest = None
        while (arrived := subscription.take()) is not None:
            newest = arrived.message
        if newest is None:
            return
        changed = side not in self._known or not _same(self._known[side], newest)
        self._known[side] = newest
        if (changed or self._pair is None) and len(self._known) == len(_SIDES):
            self._calibrate(subscription)

    def _calibrate(self, subscription: RosSubscription) -> None:
        left, right = self._known["left"], self._known["right"]
        try:
            mounting = self._link.mounting(left.header.frame_id)
        except RosDataError as error:
            self._say(str(error))
            return
        try:
            self._pair = StereoPair.by_infos((left, right), self._topics, mounting, self._link.sensors.cameras)
        except RosDataError as error:
            subscription.drop(str(error))

    def _newest(self) -> Pair[Any] | None:
        """The newest of the pairs that are complete; older ones would only be late."""
        complete: list[Pair[Any]] = []

        def join(side: Side, arrived: Arrived) -> None:
            stamp = types.stamp_of(arrived.message.header)
            if not stamp:
                raise RosDataError("it has no stamp, by which pairs are joined")
            pair = self._joiner.add(side, stamp, arrived.message)
            if pair is not None:
                complete.append(pair)

        for side, subscription in self._images.items():
            each(subscription, partial(join, side))
        return complete[-1] if complete else None

    def _publish(self, pair: Pair[Any]) -> None:
        if self._pair is None:
            self._say("images come, and no camera infos of both sides that can be used")
            return
        try:
            with self._link.service.stage("rectify"):
                frame = self._pair.frame(pair.left, pair.right, pair.stamp_ns)
        except RosDataError as error:
            self._images["left"].drop(str(error))
            return
        self._pairs.put(frame)

    def _say(self, reason: str) -> None:
        """Says what is missing, once there was time for all of it to come."""
        if time.monotonic() - self._began > _PATIENCE_S:
            self._link.reporter.say("stereo", reason)


class OneCamera:
    """Publishes the images of one camera, in a thread of its own."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._wake = threading.Event()
        name = link.settings.inputs.image
        self._images = link.graph.subscribe(name, image_type(name), SENSOR_DATA, self._wake)
        self._pace = Pace(link.sensors.frame_rate)
        self._frames = link.service.bus.publisher(topics.CAMERA, link.sensors.camera)
        self.steady = [self._images]

    def run(self) -> None:
        """Publishes images until the service stops."""
        for _ in self._link.looks(self._wake):
            each(self._images, lambda arrived: self._publish(arrived.message))

    def _publish(self, message: Any) -> None:  # noqa: ANN401, a class made at run time
        if self._link.silent or not self._pace.lets(time.monotonic()):
            return
        stamp = types.stamp_of(message.header) or now_ns()
        self._frames.put(camera_frame(message, self._images.topic, stamp))


def _same(a: Any, b: Any) -> bool:  # noqa: ANN401
    """Whether two camera infos are of one calibration."""
    if (a.width, a.height, a.distortion_model, a.header.frame_id) != (
        b.width,
        b.height,
        b.distortion_model,
        b.header.frame_id,
    ):
        return False
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in "kdrp")
