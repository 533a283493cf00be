"""A stereo pair from capture devices by OpenCV: two devices, or one that delivers both images side by side.

A device is a number, a path as ``/dev/video2``, or a stream's address. A video file is a device too: it is played at
its own rate and ends as a device that disappears.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import RetraverseError
from common.messages import now_ns

Image = NDArray[np.uint8]

_LIVE = frozenset({"V4L2", "DSHOW", "MSMF", "AVFOUNDATION", "GSTREAMER", "ORBBEC"})
_DEFAULT_RATE = 30.0
_OLDEST_S = 1.0
"""A driver's time of capture that is further back than this, or in the future, is of another clock."""


class CaptureError(RetraverseError):
    """A device that cannot be opened, or does not deliver what it should; the sentence names it."""


@dataclass(frozen=True, slots=True)
class Captured:
    """A pair as the cameras deliver it.

    Attributes:
        stamp_ns: when the left image was captured, Unix nanoseconds.
        left, right: grey (H, W) or RGB (H, W, 3).
        skew_s: by how much the right image is later, seconds; None where the driver does not tell.
    """

    stamp_ns: int
    left: Image
    right: Image
    skew_s: float | None


@dataclass(frozen=True, slots=True)
class Format:
    """What is asked of a device, which may deliver something else: pixels, images a second, and a code as ``MJPG``."""

    width: int | None = None
    height: int | None = None
    rate: float | None = None
    fourcc: str = ""


def captured_at(position_ms: float, monotonic_s: float, unix_ns: int) -> int | None:
    """The time of capture, Unix nanoseconds, of a frame whose driver gives ``position_ms`` on the monotonic clock.

    ``monotonic_s`` and ``unix_ns`` are one moment on both clocks. None where the driver's time is of another clock.
    """
    age = monotonic_s - 1e-3 * position_ms
    return unix_ns - round(1e9 * age) if 0.0 <= age < _OLDEST_S else None


@contextlib.contextmanager
def _in_silence() -> Iterator[None]:
    """Keeps OpenCV from saying of each of its backends that it cannot open a device: the error says it once."""
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)


class Device:
    """One capture device."""

    def __init__(self, source: int | str, wanted: Format) -> None:
        """Opens it.

        Raises:
            CaptureError: there is no such device, or it is in use.
        """
        self.source = source
        number = int(source) if isinstance(source, str) and source.isdecimal() else source
        try:
            with _in_silence():
                self._capture: Any = cv2.VideoCapture(number)
        except cv2.error:
            raise CaptureError(self._absent()) from None
        if not self._capture.isOpened():
            raise CaptureError(self._absent())
        backend = self._capture.getBackendName()
        self._knows_time = backend == "V4L2"
        self.is_live = backend in _LIVE
        if self.is_live:
            self._ask(wanted)
        rate = float(self._capture.get(cv2.CAP_PROP_FPS))
        self.rate = rate if 0.5 <= rate <= 1000.0 else _DEFAULT_RATE

    def grab(self) -> int | None:
        """Waits for the next frame; its time of capture, Unix nanoseconds, where the driver tells it.

        Raises:
            CaptureError: there is none.
        """
        try:
            grabbed = self._capture.grab()
        except cv2.error:
            grabbed = False
        if not grabbed:
            raise CaptureError(f"the camera {self.source} delivers no images any more: is it still connected?")
        if not self._knows_time:
            return None
        return captured_at(float(self._capture.get(cv2.CAP_PROP_POS_MSEC)), time.monotonic(), now_ns())

    def retrieve(self) -> Image:
        """The grabbed frame, grey (H, W) or RGB (H, W, 3).

        Raises:
            CaptureError: it cannot be decoded.
        """
        try:
            decoded, frame = self._capture.retrieve()
        except cv2.error:
            decoded, frame = False, None
        if not decoded or frame is None or frame.dtype != np.uint8:
            raise CaptureError(f"an image of the camera {self.source} cannot be decoded: try another fourcc")
        if frame.ndim == 3 and frame.shape[2] == 3:
            frame = cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)
        return np.asarray(frame.squeeze(), dtype=np.uint8)

    def close(self) -> None:
        """Lets the device go."""
        self._capture.release()

    def _ask(self, wanted: Format) -> None:
        # The code comes first: it decides which sizes and rates there are.
        if wanted.fourcc:
            self._capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*wanted.fourcc))
        for setting, value in (
            (cv2.CAP_PROP_FRAME_WIDTH, wanted.width),
            (cv2.CAP_PROP_FRAME_HEIGHT, wanted.height),
            (cv2.CAP_PROP_FPS, wanted.rate),
        ):
            if value is not None:
                self._capture.set(setting, value)

    def _absent(self) -> str:
        return (
            f"there is no camera {self.source}, or it is in use: check its cable, its number and who else has it open"
        )


class StereoCapture:
    """Both cameras, opened together and closed at the end of the block."""

    def __init__(self, devices: Sequence[int | str], wanted: Format, *, right_first: bool = False) -> None:
        """Opens them: the left and the right one, or one that delivers both.

        ``wanted`` is the format of one image. With ``right_first`` the first device, or half, is the right camera's.

        Raises:
            CaptureError: one cannot be opened.
        """
        each = wanted
        if len(devices) == 1 and wanted.width is not None:
            each = Format(2 * wanted.width, wanted.height, wanted.rate, wanted.fourcc)
        self._right_first = right_first
        self._devices: list[Device] = []
        try:
            for source in devices:
                self._devices.append(Device(source, each))
        except CaptureError:
            self.close()
            raise
        self._period = 1.0 / min(device.rate for device in self._devices)
        self._due = time.monotonic()
        self._stamps: list[int | None] = []
        self._arrived = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Lets the devices go."""
        for device in self._devices:
            device.close()

    def grab(self) -> int:
        """Waits for the next pair; the stamp of its left image.

        Every frame is taken from the devices, wanted or not: what they queue is old.

        Raises:
            CaptureError: a device delivers nothing.
        """
        if not all(device.is_live for device in self._devices):
            self._due = max(self._due + self._period, time.monotonic() - self._period)
            time.sleep(max(0.0, self._due - time.monotonic()))
        self._stamps = [device.grab() for device in self._devices]
        self._align()
        self._arrived = now_ns()
        return self._stamp

    def retrieve(self) -> Captured:
        """The pair that was grabbed.

        Raises:
            CaptureError: an image cannot be decoded, or does not hold two.
        """
        images = [device.retrieve() for device in self._devices]
        if len(images) == 1:
            images = list(self._halves(images[0]))
        skew = self._skew
        if self._right_first:
            images.reverse()
            skew = None if skew is None else -skew
        return Captured(self._stamp, images[0], images[1], skew)

    @property
    def _stamp(self) -> int:
        left = self._stamps[-1 if self._right_first else 0]
        return self._arrived if left is None else left

    @property
    def _skew(self) -> float | None:
        """Seconds from the first device's image to the last one's."""
        first, last = self._stamps[0], self._stamps[-1]
        return None if first is None or last is None else 1e-9 * (last - first)

    def _align(self) -> None:
        """Lets the device that is behind by more than half a period catch up by one frame."""
        skew = self._skew
        if skew is not None and abs(skew) > 0.5 * self._period:
            behind = 0 if skew > 0.0 else -1
            self._stamps[behind] = self._devices[behind].grab()

    def _halves(self, image: Image) -> tuple[Image, Image]:
        if image.shape[1] % 2:
            raise CaptureError(
                f"the camera {self._devices[0].source} delivers {image.shape[1]}x{image.shape[0]} pixels, which are no "
                "two images side by side: name two devices, or another format"
            )
        half = image.shape[1] // 2
        return np.ascontiguousarray(image[:, :half]), np.ascontiguousarray(image[:, half:])
