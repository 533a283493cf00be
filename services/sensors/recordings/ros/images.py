"""ROS's images and camera infos: decoded, and rectified where they are raw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.camera import OPTICAL_IN_VEHICLE, StereoCamera
from common.geometry import Array
from services.sensors.recordings.images import Image, RecordingError

_CONVERSIONS: dict[str, tuple[int, int | None]] = {
    "mono8": (1, None),
    "8UC1": (1, None),
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "8UC3": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    # OpenCV names a pattern by the second row's second and third pixel.
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2RGB),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2RGB),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2RGB),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2RGB),
    "mono16": (1, None),
    "16UC1": (1, None),
}
"""Channels of each of ROS's encodings, and OpenCV's way to RGB."""

_FISHEYE = ("equidistant", "fisheye")
_MODELS = ("plumb_bob", "rational_polynomial", "radtan", "", *_FISHEYE)


def decode_image(message: Any, topic: str) -> Image:  # noqa: ANN401, a class that rosbags makes at run time
    """The pixels (H, W) or (H, W, 3) RGB, uint8, of an ``Image`` or ``CompressedImage``; of 16 bits the upper 8.

    Raises:
        RecordingError: the image is of an encoding that is not known, or not whole.
    """
    if "Compressed" in type(message).__name__:
        decoded = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_ANYCOLOR)
        if decoded is None:
            raise RecordingError(f"an image of '{topic}' cannot be decoded: was it cut short?")
        return np.asarray(decoded if decoded.ndim == 2 else cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB), np.uint8)
    if message.encoding not in _CONVERSIONS:
        raise RecordingError(f"'{topic}' is encoded as '{message.encoding}': {', '.join(_CONVERSIONS)} are known")
    channels, conversion = _CONVERSIONS[message.encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    bytes_each = 2 if "16" in message.encoding else 1
    row = width * channels * bytes_each
    data = np.asarray(message.data, np.uint8)
    if step < row or len(data) < step * height or row == 0:
        raise RecordingError(f"an image of '{topic}' is not whole: was it cut short?")
    rows = data[: step * height].reshape(height, step)[:, :row]
    if bytes_each == 2:
        return np.ascontiguousarray(rows[:, (0 if message.is_bigendian else 1) :: 2])
    pixels = np.ascontiguousarray(rows).reshape((height, width) if channels == 1 else (height, width, channels))
    return pixels if conversion is None else np.asarray(cv2.cvtColor(pixels, conversion), np.uint8)


@dataclass(frozen=True, slots=True)
class Rectifier:
    """Brings a raw image to the rectified one; None for ``maps`` where it is one already."""

    maps: tuple[NDArray[Any], NDArray[Any]] | None

    def __call__(self, image: Image) -> Image:
        """The rectified image."""
        if self.maps is None:
            return image
        return np.asarray(cv2.remap(image, *self.maps, cv2.INTER_LINEAR), np.uint8)


def rectifier(info: Any, image_topic: str) -> Rectifier:  # noqa: ANN401, a CameraInfo
    """What a camera's images need: by ROS's names an image with ``rect`` in its own is rectified already.

    Raises:
        RecordingError: the distortion is of a model that is not known.
    """
    K, D, R, P = _matrices(info)
    straight = not D.any() and np.allclose(R, np.eye(3)) and np.allclose(K, P[:, :3])
    if straight or "rect" in image_topic.removesuffix("/compressed").rpartition("/")[2]:
        return Rectifier(None)
    if info.distortion_model not in _MODELS:
        raise RecordingError(f"'{image_topic}' has distortion of the model '{info.distortion_model}': rectify it first")
    size = (int(info.width), int(info.height))
    if info.distortion_model in _FISHEYE:
        maps = cv2.fisheye.initUndistortRectifyMap(K, D[:4], R, P[:, :3], size, cv2.CV_16SC2)
    else:
        maps = cv2.initUndistortRectifyMap(K, D, R, P[:, :3], size, cv2.CV_16SC2)
    return Rectifier((maps[0], maps[1]))


def stereo_camera(
    infos: tuple[Any, Any],
    T_vehicle_optical: Array | None,
    topics: tuple[str, str],
) -> StereoCamera:
    """The rectified pair's camera; ``T_vehicle_optical`` is of the raw left one, None where it is not known.

    Raises:
        RecordingError: a camera is not calibrated, or the two are no rectified pair.
    """
    left, right = infos
    (_, _, R, P), (_, _, _, Q) = _matrices(left), _matrices(right)
    for projection, topic in ((P, topics[0]), (Q, topics[1])):
        if not (projection[0, 0] > 0.0 and projection[1, 1] > 0.0):
            raise RecordingError(f"'{topic}' holds no calibration: its P has no focal length")
    if not np.allclose(P[:, :3], Q[:, :3], rtol=1e-4, atol=1e-2):
        raise RecordingError(f"'{topics[0]}' and '{topics[1]}' are not of a rectified pair: their P must agree")
    fx = float(P[0, 0])
    baseline = float(P[0, 3] - Q[0, 3]) / fx
    if not baseline > 1e-4:
        raise RecordingError(
            f"'{topics[1]}' has no baseline: P's fourth column tells how far it is to the right of the left one"
        )
    # The rectified camera is the raw one, turned: p_rectified = R p_raw.
    T_optical_rectified = geometry.transform(R.T, np.zeros(3))
    mounting = OPTICAL_IN_VEHICLE if T_vehicle_optical is None else T_vehicle_optical @ T_optical_rectified
    size = int(left.width), int(left.height)
    return StereoCamera(*size, fx, float(P[1, 1]), float(P[0, 2]), float(P[1, 2]), baseline, np.array(mounting))


def _matrices(info: Any) -> tuple[Array, Array, Array, Array]:  # noqa: ANN401, ROS 1 has capitals where ROS 2 has none
    """K (3, 3), D (N,), R (3, 3) and P (3, 4) of a camera info."""
    K, D, R, P = (
        np.asarray(getattr(info, name, getattr(info, name.upper(), ())), np.float64) for name in ("k", "d", "r", "p")
    )
    R = R.reshape(3, 3)
    return K.reshape(3, 3), D, R if R.any() else np.eye(3), P.reshape(3, 4)
