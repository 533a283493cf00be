"""The estimator of this version on a recorded run: the same frames, wheels, states and routes, in the same order."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, cast

from cli.errors import CommandError
from cli.replay.bus import ReplayBus
from cli.replay.inputs import OnFrame, inputs
from common import config, logs, topics
from common.bus import Bus
from common.config import RobotConfig
from common.messages import StereoFrame
from common.service import Service
from services.estimator.sensors import Sensor, sensor_of
from services.estimator.sensors.stereo import StereoFrames, StereoSensor
from services.estimator.service import Estimator
from services.estimator.settings import Settings
from services.mapstore.store import Store
from services.sensors.recordings.mcap import McapTimeline, McapWriter
from services.sensors.recordings.mcap.writer import Origin
from services.sensors.recordings.timeline import Entry

OUTPUTS = (topics.ODOMETRY, topics.LOCALIZATION)
"""What the estimator publishes."""

_PROCESS = "estimator"
_SETTLE_S = 10.0
_POLL_S = 0.0005


class _StereoInTurn(StereoSensor):
    """A stereo camera whose streams and bundle adjustment take turns, so that the outcome depends on no timing."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self._stereo = settings.stereo

    def open(self, frame: StereoFrame) -> StereoFrames:
        """A pipeline without threads."""
        return StereoFrames(frame.camera.camera(), self._stereo)


@contextmanager
def recorded_configuration(recording: McapTimeline, path: Path | None) -> Iterator[RobotConfig]:
    """The configuration that is named, else the one that was recorded.

    Raises:
        CommandError: the recording has none.
        ConfigurationError: it cannot be used.
    """
    if path is not None:
        yield config.load(path)
        return
    text = recording.configuration()
    if not text:
        raise CommandError(f"{recording.name} holds no configuration of its robot: name one with --config")
    with tempfile.TemporaryDirectory(prefix="vtr-replay-") as folder:
        file = Path(folder) / "robot.toml"
        file.write_text(text, encoding="utf-8")
        yield config.load(file)


def replay(
    recording: McapTimeline, configuration: RobotConfig, store_file: Path | None, on_frame: OnFrame
) -> list[Entry]:
    """What the estimator says of a recorded run, in order.

    Frames that it did not use then, where it was too slow for them, are not used now. ``store_file`` is the map store
    as it was when the recording began, which is copied; without one the store is empty.

    Raises:
        RecordingError: the recording cannot be read.
        CommandError: it has no frames of the robot's sensor, or the store cannot be copied.
    """
    logs.configure(configuration.robot.name, _PROCESS, "critical")
    settings = configuration.settings("estimator", Settings)
    kind = configuration.robot.sensor
    sensor: Sensor[Any, Any, Any] = _StereoInTurn(settings) if kind == "stereo" else sensor_of(kind, settings)
    frames = sensor.topic.key.format(name=sensor.name)
    if frames not in recording.counts:
        raise CommandError(f"{recording.name} has no {frames}: record it, or name the robot's settings with --config")
    with tempfile.TemporaryDirectory(prefix="vtr-replay-") as folder:
        store = Store(_copied(store_file, Path(folder)))
        try:
            return _estimate(inputs(recording, frames, on_frame), frames, configuration, sensor, store)
        finally:
            store.close()


def write(entries: list[Entry], folder: Path, configuration: RobotConfig) -> Path:
    """Writes what a replay said to an MCAP file.

    Raises:
        RecordingError: it cannot be written.
    """
    text = configuration.path.read_text(encoding="utf-8")
    with McapWriter(folder, configuration.robot.name, 1 << 62, text) as writer:
        for sequence, entry in enumerate(entries):
            writer.write(entry.topic, entry.key, entry.message, Origin(_PROCESS, "replay"), sequence, entry.time_ns)
    return writer.files[0]


def _copied(store_file: Path | None, folder: Path) -> Path:
    place = folder / "maps.sqlite"
    if store_file is not None:
        try:
            for part in store_file.parent.glob(f"{store_file.name}*"):
                shutil.copy(part, folder / f"maps.sqlite{part.name.removeprefix(store_file.name)}")
            if not place.exists():
                raise CommandError(f"there is no store {store_file}: give its maps.sqlite")
        except OSError as error:
            raise CommandError(f"cannot copy the store {store_file}: {error.strerror}") from None
    return place


def _estimate(
    inputs: Iterator[Entry], frames: str, configuration: RobotConfig, sensor: Sensor[Any, Any, Any], store: Store
) -> list[Entry]:
    settings = configuration.settings("estimator", Settings)
    bus = ReplayBus(configuration.robot.name, inputs, frames, store)
    service = Service(_PROCESS, configuration, cast("Bus", bus))
    estimator: Estimator[Any, Any, Any] = Estimator(service, settings, sensor)
    bus.between, bus.ended = partial(_settle, estimator), service.stop.set
    try:
        estimator.run()
    finally:
        service.end()
    if service.failed:
        raise CommandError("the estimator failed on this recording: vtr replay-diff --debug says more")
    return bus.outputs


def _settle(estimator: Estimator[Any, Any, Any]) -> None:
    """Waits until what runs beside the frames has come to rest: on a robot it has the time between two frames."""
    end = time.monotonic() + _SETTLE_S
    while estimator.busy and time.monotonic() < end:
        time.sleep(_POLL_S)
