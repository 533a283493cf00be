"""The driver of a real stereo pair: captured by OpenCV, rectified by the robot's calibration, published."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import structlog

from common import messages as m
from common import topics
from common.errors import ConfigurationError
from common.service import Service
from services.sensors.calibration import file
from services.sensors.calibration.detection import as_grey
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.rectify import Rectifier
from services.sensors.capture import Captured, CaptureError, Format, StereoCapture
from services.sensors.settings import Settings

log = structlog.get_logger()

_RETRY_S = 1.0
_REPORT_S = 10.0
"""What goes wrong again and again is said once in this time."""


class CameraDriver:
    """Two capture devices, or one, as ``sensor/stereo/<name>``; a device that is lost is opened again."""

    def __init__(self, service: Service, settings: Settings, quiet: str) -> None:
        """Reads the calibration; nothing is published while the process ``quiet`` is there.

        Raises:
            ConfigurationError: there is no calibration, or it cannot be used.
        """
        self._service = service
        self._cameras = settings.cameras
        self._period = 1.0 / settings.frame_rate
        self._rectifier = load_rectifier(service, settings)
        self._message = m.CameraModel.of(self._rectifier.camera)
        self._pairs = service.bus.publisher(topics.STEREO, settings.camera)
        self._presence = service.bus.presence()
        self._quiet = quiet
        self._reported: dict[str, float] = {}

    def run(self) -> None:
        """Captures until the service stops."""
        self._service.thread(self._see, "cameras")
        self._service.ready()
        self._service.stop.wait()

    def _see(self) -> None:
        while not self._service.stop.is_set():
            try:
                with self._open() as capture:
                    self._stream(capture)
            except CaptureError as error:
                self._report(str(error))
                self._service.stop.wait(_RETRY_S)

    def _open(self) -> StereoCapture:
        wanted, camera = self._cameras, self._rectifier.camera
        form = Format(camera.width, camera.height, wanted.rate, wanted.fourcc)
        return StereoCapture(wanted.devices, form, right_first=wanted.right_first)

    def _stream(self, capture: StereoCapture) -> None:
        """Publishes pairs of opened devices until one fails or the service stops."""
        self._check_size(first := _first(capture))
        log.info("the cameras deliver", devices=list(self._cameras.devices), width=first.left.shape[1])
        for _ in self._when_due(capture):
            with self._service.stage("retrieve"):
                pair = capture.retrieve()
            self._check_size(pair)
            if pair.skew_s is not None and abs(pair.skew_s) > self._cameras.max_skew:
                self._report(
                    f"left and right image are {1e3 * abs(pair.skew_s):.0f} ms apart and not used: the cameras must be "
                    "triggered together"
                )
                continue
            self._publish(pair)

    def _when_due(self, capture: StereoCapture) -> Iterator[None]:
        """After each grabbed pair that the configured rate asks for."""
        due = time.monotonic()
        while not self._service.stop.is_set():
            capture.grab()
            now = time.monotonic()
            if now < due or self._quiet in self._presence:
                continue
            due = max(due + self._period, now - self._period)
            yield

    def _publish(self, pair: Captured) -> None:
        left, right = (as_grey(image) if self._cameras.grey else image for image in (pair.left, pair.right))
        with self._service.stage("rectify"):
            left, right = self._rectifier.rectify(left, right)
        self._pairs.put(m.StereoFrame(stamp=pair.stamp_ns, camera=self._message, left=left, right=right))

    def _check_size(self, pair: Captured) -> None:
        """Refuses images that the calibration is not for.

        Raises:
            CaptureError: their size is another, or one is grey and the other is not.
        """
        c = self._rectifier.camera
        for image in (pair.left, pair.right):
            if image.shape[:2] != (c.height, c.width):
                raise CaptureError(
                    f"the cameras deliver {image.shape[1]}x{image.shape[0]} pixels an image, the calibration is for "
                    f"{c.width}x{c.height}: calibrate at the size that they deliver"
                )
        if pair.left.shape != pair.right.shape:
            raise CaptureError("one camera delivers grey images and the other colour: set grey = true")

    def _report(self, sentence: str) -> None:
        now = time.monotonic()
        if now - self._reported.get(sentence, -_REPORT_S) >= _REPORT_S:
            self._reported[sentence] = now
            log.warning("no images", reason=sentence)


def load_rectifier(service: Service, settings: Settings) -> Rectifier:
    """The rectifier of the calibration that the settings name; its path begins at the robot's TOML file.

    Raises:
        ConfigurationError: none is named, or it cannot be used.
    """
    if settings.calibration is None:
        raise ConfigurationError(
            f"{service.config.path}: the driver 'cameras' needs a calibration: make it with vtr calibrate, and name "
            "its file as 'calibration' in [sensors]"
        )
    path = service.config.path.absolute().parent / settings.calibration.expanduser()
    stored = file.load(path)
    if stored.mounting == file.MountingTable():
        log.warning("the camera's mounting was never measured: it counts as the vehicle's origin", file=str(path))
    try:
        rectifier = Rectifier.of(stored.rig, stored.mounting.transform())
    except CalibrationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    light = settings.cameras
    return replace(rectifier, camera=replace(rectifier.camera, wavelengths=light.wavelengths, transfer=light.transfer))


def _first(capture: StereoCapture) -> Captured:
    capture.grab()
    return capture.retrieve()
