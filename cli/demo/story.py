"""The demo's story: bring a robot up, teach a route, put the robot back beside its start, repeat the route."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from cli import client
from cli.daylight import Times
from cli.demo.driver import Driver, DriverSettings
from cli.demo.recorder import Recorder, Recording
from cli.demo.sensor import Sensor
from cli.errors import CommandError
from cli.supervision.supervised import Supervised
from common import config, topics
from common.bus import Bus
from common.geometry import Array
from common.ids import VertexId
from common.messages import Command, Done, GraphQuery, MapList, Place, StateName, VelocityCommand, WorldTime, now_ns
from services.sensors.settings import Settings as SensorSettings
from services.sensors.world import Scene

_DRIVE_PERIOD_S = 0.05
_READY_S = 120.0
_SETTLE_S = 1.0
_LIGHT_S = 60.0
_EXPOSURE_S = 3.0
"""What the auto exposure takes to follow a new light."""

Progress = Callable[[str, float], None]
"""Told what is going on, and how much of it is done, 0 to 1."""


@dataclass(frozen=True, slots=True)
class Offset:
    """Where the robot is put for the repeat, beside and turned from the start of the taught path."""

    lateral_m: float = 0.3
    heading_deg: float = 5.0


def write_config(path: Path, directory: Path, light: Times | None = None, sensor: Sensor = Sensor.STEREO) -> None:
    """A robot in the synthetic world with everything at its defaults, on a port that is free now.

    With ``light`` the world begins at the time of the teach. Where the repeat has another the sky is clear: the world's
    clouds stand still for hours, as none do, and would be landmarks.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    path.write_text(
        f'[robot]\nname = "demo"\nsensor = "{sensor}"\nenvironment = "garden"\n'
        f'directory = {json.dumps(str(directory))}\n\n[bus]\nendpoint = "tcp/127.0.0.1:{port}"\n\n'
        f'[sensors]\ndriver = "synthetic"\nsimulate = ["{sensor.simulated}"]\n' + _world_table(light),
        encoding="utf-8",
    )


def _world_table(light: Times | None) -> str:
    if light is None:
        return ""
    clear = "clouds = 0.0\n" if light.repeat != light.teach else ""
    return f"\n[sensors.world]\ntime = {light.teach.isoformat()}\n{clear}"


class Story:
    """A robot's processes and an operator who teaches and repeats; a context manager."""

    def __init__(self, config_path: Path, progress: Progress) -> None:
        self._config = config.load(config_path)
        self.supervised = Supervised(config_path)
        self._progress = progress
        self._connection = client.connect(self._config)
        self.bus: Bus

    def __enter__(self) -> Self:
        self._progress("starting the robot's processes", 0.0)
        self.supervised.start()
        try:
            self.supervised.wait_ready(on_change=lambda present: self._progress("starting", len(present) / 8))
            self.bus = self._connection.__enter__()
            self._await_data()
        except BaseException:
            self.supervised.stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._connection.__exit__(kind, error, trace)
        self.supervised.stop()

    def route(self) -> Array:
        """The path (N, 3) of x, y, yaw that the human wants to teach."""
        settings = self._config.settings("sensors", SensorSettings)
        return Scene.build(settings.world.scene).demo_route()

    def teach(self, route: Array, driver_settings: DriverSettings) -> tuple[str, Recording]:
        """Drives the route by hand while the robot learns it; returns the map's id and what was recorded."""
        recorder = Recorder(self.bus)
        self._await(lambda: recorder.truth() is not None, "the world's truth", 10.0)
        self._command(Command(action="teach", start_place="start"))
        self._drive(Driver(route, driver_settings), recorder)
        # The store answers once the last vertex is on disk.
        self._command(Command(action="finish", end_place="end"), timeout=30.0)
        maps: MapList = self.bus.ask(topics.MAPS, GraphQuery(environment=self._config.robot.environment))
        return maps.maps[-1].record.id, recorder.stop()

    def set_time(self, moment: datetime) -> None:
        """Moves the world's sun to where it stands at a moment, and gives the camera's exposure time to follow."""
        self._progress(f"waiting until it is {moment:%H:%M} in the world", 0.0)
        self.bus.ask(topics.TRUTH_TIME, WorldTime(stamp=round(moment.timestamp() * 1e9)), timeout=_LIGHT_S)
        time.sleep(_EXPOSURE_S)

    def repeat(self, map_id: str, start: Array, offset: Offset, timeout: float) -> Recording:
        """Puts the robot beside the start pose (4, 4) of the taught path and lets it drive to the path's end."""
        self._put_down(start, offset)
        recorder = Recorder(self.bus)
        self._command(Command(action="repeat", goal="end", vertex=VertexId(map_id, 0)), timeout=10.0)
        length = self._length_of(map_id)
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            state = recorder.state()
            if state is not None and state.name in (StateName.IDLE, StateName.PAUSED) and recorder.began():
                break
            self._progress("repeating the route", min(1.0, recorder.arclength() / length))
            time.sleep(_DRIVE_PERIOD_S)
        time.sleep(_SETTLE_S)
        return recorder.stop()

    def _drive(self, driver: Driver, recorder: Recorder) -> None:
        teleop = self.bus.publisher(topics.TELEOP)
        due = time.monotonic()
        while True:
            truth = recorder.truth()
            if truth is None:
                raise CommandError("the synthetic world fell silent")
            command = driver.command(truth.T_world_vehicle, _DRIVE_PERIOD_S)
            v, w = command or (0.0, 0.0)
            teleop.put(VelocityCommand(stamp=now_ns(), v=v, w=w))
            if command is None and abs(truth.v) < 0.01:
                return
            self._progress("teaching the route", driver.progress / driver.length)
            state = recorder.state()
            if state is not None and state.name == StateName.PAUSED:
                raise CommandError(f"the teach was interrupted: {state.reason}")
            due += _DRIVE_PERIOD_S
            time.sleep(max(0.0, due - time.monotonic()))

    def _put_down(self, start: Array, offset: Offset) -> None:
        left = start[:2, 1]
        x, y = start[:2, 3] + offset.lateral_m * left
        yaw = float(np.arctan2(start[1, 0], start[0, 0]) + np.radians(offset.heading_deg))
        self.bus.ask(topics.TRUTH_PLACE, Place(x=float(x), y=float(y), yaw=yaw))
        time.sleep(_SETTLE_S)

    def _length_of(self, map_id: str) -> float:
        maps: MapList = self.bus.ask(topics.MAPS, GraphQuery(map=map_id))
        return max(maps.maps[0].length, 1.0)

    def _command(self, command: Command, timeout: float = 5.0) -> Done:
        answer: Done = self.bus.ask(topics.MISSION, command, timeout=timeout)
        return answer

    def _await_data(self) -> None:
        """Waits until the camera sees and the estimator measures."""
        odometry = self.bus.subscribe(topics.ODOMETRY)
        self._await(lambda: (last := odometry.last()) is not None and last.message.success, "odometry", _READY_S)

    def _await(self, condition: Callable[[], bool], what: str, deadline: float) -> None:
        start = time.monotonic()
        while not condition():
            if time.monotonic() - start > deadline:
                raise CommandError(
                    f"no {what} within {deadline:.0f} s; see the logs in {self._config.directory / 'log'}"
                )
            self._progress(f"waiting for {what}", min(1.0, (time.monotonic() - start) / deadline))
            time.sleep(_DRIVE_PERIOD_S)
