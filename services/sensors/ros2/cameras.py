"""Images of a ROS graph as a rectified stereo pair, by its camera infos or by a calibration of our own."""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from common.geometry import Array
from common.messages import CameraFrame, CameraModel, StereoFrame
from common.messages.base import SIDE
from services.sensors.calibration.rectify import Rectifier as CalibratedRectifier
from services.sensors.recordings.images import RecordingError
from services.sensors.recordings.ros.images import Rectifier, decode_image, rectifier, stereo_camera
from services.sensors.ros2.errors import RosDataError
from services.sensors.settings import CameraSettings

Image = NDArray[np.uint8]

_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"
_PNG_END, _JPEG_END = b"IEND\xaeB\x60\x82", b"\xff\xd9"
_TAIL = 1024
"""Bytes in which an image's end mark stands: some cameras put something behind it."""
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG's markers that tell the image's size."""


def size_of(data: bytes) -> tuple[int, int] | None:
    """Width and height that a JPEG or PNG says it has, before anything is decoded; None where it is neither.

    The decoder would make room for whatever a header claims.
    """
    if data.startswith(_PNG) and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return width, height
    at = 2 if data.startswith(_JPEG) else len(data)
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker in _FRAMES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        # Any number of 0xFF may fill up before a marker.
        at += 1 if marker == 0xFF else 2 + int(struct.unpack_from(">H", data, at + 2)[0])
    return None


def pixels(message: Any, topic: str, size: tuple[int, int] | None = None) -> Image:  # noqa: ANN401, a class made at run time
    """The pixels (H, W) or (H, W, 3) RGB of an ``Image`` or a ``CompressedImage``; a view of its bytes where it can be.

    ``size`` is the width and height that it must have, where that is known.

    Raises:
        RosDataError: it is of another size, of an encoding that is not known, or not whole.
    """
    data = getattr(message, "data", None)
    if hasattr(message, "format"):
        content = bytes(np.asarray(data, np.uint8))
        told = size_of(content)
        if told is None:
            raise RosDataError(f"it is compressed as {message.format!a}, and neither JPEG nor PNG")
        end = content.rstrip(b"\0")[-_TAIL:]
        if _PNG_END not in end and _JPEG_END not in end:
            raise RosDataError("the compressed image is cut short")
    else:
        told = int(message.width), int(message.height)
    _check_size(told, size)
    try:
        return decode_image(message, topic)
    except (RecordingError, ValueError, cv2.error) as error:
        raise RosDataError(" ".join(str(error).split())[:200]) from None


def camera_frame(message: Any, topic: str, stamp_ns: int) -> CameraFrame:  # noqa: ANN401
    """An image of one camera of which nothing is known.

    Raises:
        RosDataError: it cannot be used.
    """
    return CameraFrame(stamp=stamp_ns, image=pixels(message, topic))


@dataclass(frozen=True, slots=True)
class StereoPair:
    """A calibrated pair: brings two images to a frame.

    Attributes:
        model: of the rectified pair.
        topics: of the left and the right image.
        maps: what rectifies each side.
        calibration: what rectifies both, in place of ``maps``.
    """

    model: CameraModel
    topics: tuple[str, str]
    maps: tuple[Rectifier, Rectifier] = (Rectifier(None), Rectifier(None))
    calibration: CalibratedRectifier | None = None

    @classmethod
    def by_infos(
        cls, infos: tuple[Any, Any], topics: tuple[str, str], T_vehicle_optical: Array | None, light: CameraSettings
    ) -> StereoPair:
        """By the camera infos of the two sides; ``light`` has the cameras' wavelengths and transfer curve.

        ``T_vehicle_optical`` (4, 4) is of the raw left camera; None puts it at the vehicle's origin.

        Raises:
            RosDataError: they are of no rectified pair.
        """
        for info in infos:
            _check_size((int(info.width), int(info.height)), None)
            if not all(np.isfinite(np.asarray(getattr(info, name))).all() for name in "kdrp"):
                raise RosDataError("a camera info is not finite")
        try:
            camera = stereo_camera(infos, T_vehicle_optical, topics)
            camera = replace(camera, wavelengths=light.wavelengths, transfer=light.transfer)
            made = rectifier(infos[0], topics[0]), rectifier(infos[1], topics[1])
            return cls(CameraModel.of(camera), topics, made)
        except (RecordingError, ValidationError) as error:
            raise RosDataError(f"the camera infos are of no pair: {error}") from None

    @classmethod
    def by_calibration(cls, calibration: CalibratedRectifier, topics: tuple[str, str]) -> StereoPair:
        """By a file of ``vtr calibrate``, which is of images as the cameras deliver them."""
        return cls(CameraModel.of(calibration.camera), topics, calibration=calibration)

    def frame(self, left: Any, right: Any, stamp_ns: int) -> StereoFrame:  # noqa: ANN401
        """The rectified pair of two images.

        Raises:
            RosDataError: one cannot be used.
        """
        size = self.model.width, self.model.height
        first, second = (pixels(m, topic, size) for m, topic in zip((left, right), self.topics, strict=True))
        if first.shape != second.shape:
            raise RosDataError("one image of the pair is grey and the other is not")
        if self.calibration is not None:
            first, second = self.calibration.rectify(first, second)
        else:
            first, second = self.maps[0](first), self.maps[1](second)
        return StereoFrame(stamp=stamp_ns, camera=self.model, left=first, right=second)


def _check_size(told: tuple[int, int], wanted: tuple[int, int] | None) -> None:
    if wanted is not None and told != wanted:
        raise RosDataError(f"it has {told[0]}x{told[1]} pixels, and its calibration is for {wanted[0]}x{wanted[1]}")
    if not all(SIDE[0] <= side <= SIDE[1] for side in told):
        raise RosDataError(f"an image's sides have {SIDE[0]} to {SIDE[1]} pixels, not {told[0]} and {told[1]}")
