"""The demo's story: bring a robot up, teach a route, put the robot back beside its start, repeat the route."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from cli import client, robot
from cli.demo.driver import Driver, DriverSettings
from cli.demo.recorder import Recorder, Recording
from cli.errors import CommandError
from cli.processes import Process
from cli.supervision.supervised import Supervised
from common import config, topics
from common.bus import Bus
from common.geometry import Array
from common.ids import VertexId
from common.messages import (
    Command,
    Done,
    Goal,
    GraphQuery,
    MapList,
    MapSummary,
    Place,
    StateName,
    SyncState,
    VelocityCommand,
    WorldTime,
    now_ns,
)
from services.sensors.settings import Settings as SensorSettings
from services.sensors.world.route import waisted_loop

_DRIVE_PERIOD_S = 0.05
_READY_S = 120.0
_SETTLE_S = 1.0
_LIGHT_S = 60.0
_PLAN_S = 60.0
_EXPOSURE_S = 3.0
"""What the auto exposure takes to follow a new light."""

Progress = Callable[[str, float], None]
"""Told what is going on, and how much of it is done, 0 to 1."""

Announce = Callable[[str], None]
"""Told where a robot's web page is, once it is up."""


@dataclass(frozen=True, slots=True)
class Offset:
    """Where the robot is put for the repeat, beside and turned from the start of the taught path."""

    lateral_m: float = 0.3
    heading_deg: float = 5.0


class Story:
    """A robot's processes and an operator who teaches and repeats; a context manager."""

    def __init__(
        self,
        config_path: Path,
        progress: Progress,
        table: Sequence[Process] | None = None,
        announce: Announce = lambda _address: None,
    ) -> None:
        self._config = config.load(config_path)
        self.supervised = Supervised(config_path, table)
        self._progress = progress
        self._announce = announce
        self._connection = client.connect(self._config)
        self.bus: Bus

    def __enter__(self) -> Self:
        self._progress("starting the robot's processes", 0.0)
        self.supervised.start()
        try:
            self.supervised.wait_ready(
                on_change=lambda present: self._progress("starting", len(present) / len(self.supervised.table))
            )
            self.bus = self._connection.__enter__()
            self._announce(robot.page_address(self._config))
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
        return waisted_loop(settings.world.scene.route_length)

    def teach(
        self, route: Array, driver_settings: DriverSettings, ends: tuple[str, str] = ("start", "end")
    ) -> tuple[str, Recording]:
        """Drives the route by hand while the robot learns it; returns the map's id and what was recorded.

        ``ends`` are the names of the places that it leads from and to.
        """
        recorder = Recorder(self.bus)
        self.await_(lambda: recorder.truth() is not None, "the world's truth", 10.0)
        self._command(Command(action="teach", start_place=ends[0]))
        self._drive(Driver(route, driver_settings), recorder)
        # The store answers once the last vertex is on disk.
        self._command(Command(action="finish", end_place=ends[1]), timeout=30.0)
        return self.maps()[-1].record.id, recorder.stop()

    def set_time(self, moment: datetime) -> None:
        """Moves the world's sun to where it stands at a moment, and gives the camera's exposure time to follow."""
        self._progress(f"waiting until it is {moment:%H:%M} in the world", 0.0)
        self.bus.ask(topics.TRUTH_TIME, WorldTime(stamp=round(moment.timestamp() * 1e9)), timeout=_LIGHT_S)
        time.sleep(_EXPOSURE_S)

    def repeat(
        self,
        start: Array,
        offset: Offset,
        length: float,
        timeout: float,
        whence: VertexId | str,
        goal: str = "end",
    ) -> Recording:
        """Puts the robot beside the start pose (4, 4) of the taught path and lets it drive to the path's end, a place.

        The operator says where it stands: at a vertex of its own store or, of a path that only others know, at a place.
        """
        x, y = start[:2, 3] + offset.lateral_m * start[:2, 1]
        self.put_down(x, y, np.arctan2(start[1, 0], start[0, 0]) + np.radians(offset.heading_deg))
        recorder = Recorder(self.bus)
        where = {"start_place": whence} if isinstance(whence, str) else {"vertex": whence}
        self._command(Command(action="repeat", goal=Goal(to=goal), **where), timeout=_PLAN_S)
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            state = recorder.state()
            if state is not None and state.name in (StateName.IDLE, StateName.PAUSED) and recorder.began():
                break
            self._progress("repeating the route", min(1.0, recorder.arclength() / length))
            time.sleep(_DRIVE_PERIOD_S)
        time.sleep(_SETTLE_S)
        return recorder.stop()

    def maps(self) -> list[MapSummary]:
        """The robot's own maps, the oldest first."""
        answer: MapList = self.bus.ask(topics.MAPS, GraphQuery(environment=self._config.robot.environment))
        return answer.maps

    def await_shared(self, map_id: str, deadline: float) -> MapSummary:
        """Waits until a map of this robot is in the fleet's storage."""

        def stored() -> MapSummary:
            maps: MapList = self.bus.ask(topics.MAPS, GraphQuery(map=map_id))
            return maps.maps[0]

        self.await_(lambda: stored().sync is SyncState.SYNCED, f"map {map_id} in the fleet's storage", deadline)
        return stored()

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

    def put_down(self, x: float, y: float, yaw: float) -> None:
        """Carries the robot to a pose of the plane."""
        self.bus.ask(topics.TRUTH_PLACE, Place(x=float(x), y=float(y), yaw=float(yaw)))
        time.sleep(_SETTLE_S)

    def _command(self, command: Command, timeout: float = 5.0) -> Done:
        answer: Done = self.bus.ask(topics.MISSION, command, timeout=timeout)
        return answer

    def _await_data(self) -> None:
        """Waits until the camera sees and the estimator measures."""
        odometry = self.bus.subscribe(topics.ODOMETRY)
        self.await_(lambda: (last := odometry.last()) is not None and last.message.success, "odometry", _READY_S)

    def await_(self, condition: Callable[[], bool], what: str, deadline: float) -> None:
        """Waits for a condition.

        Raises:
            CommandError: it does not come true within ``deadline`` seconds.
        """
        start = time.monotonic()
        while not condition():
            if time.monotonic() - start > deadline:
                raise CommandError(
                    f"no {what} within {deadline:.0f} s; see the logs in {self._config.directory / 'log'}"
                )
            self._progress(f"waiting for {what}", min(1.0, (time.monotonic() - start) / deadline))
            time.sleep(_DRIVE_PERIOD_S)
