"""The sensors' topics and loops: the synthetic world's frames, wheel odometry and truth out; ``command/safe`` in."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from datetime import UTC, datetime

import structlog

from common import messages as m
from common import topics
from common.service import Service
from services.sensors.settings import Settings
from services.sensors.standing_place import StandingPlace
from services.sensors.world import BaseState, World

log = structlog.get_logger()

PLAYER = "player"
"""Process name of a playback, which takes the sensors' place while it is there."""


def main(service: Service) -> None:
    """Runs the configured driver until the service stops."""
    settings = service.config.settings("sensors", Settings)
    if settings.driver == "none":
        log.info("no driver is configured; a playback may publish the sensors' topics")
        service.ready()
        service.stop.wait()
        return
    SyntheticDriver(service, settings).run()


class SyntheticDriver:
    """The synthetic world in real time: its base in one thread, its camera in another."""

    def __init__(self, service: Service, settings: Settings) -> None:
        bus = service.bus
        self._service = service
        self._settings = settings
        self._place = StandingPlace(service.config.directory / "run" / "standing_place")
        self._stood = self._at_rest()
        self._world = World(settings.world)
        self._lock = threading.Lock()
        self._presence = bus.presence()
        self._safe = bus.subscribe(topics.SAFE)
        self._frames = bus.publisher(topics.STEREO, settings.camera)
        self._odometry = bus.publisher(topics.WHEEL_ODOMETRY)
        self._truth = bus.publisher(topics.TRUTH)

    def run(self) -> None:
        """Starts where the robot stood, then drives and renders."""
        stood = self._stood
        if stood is not None:
            self._world.restore(stood)
            log.info("the robot stands where it stood", x=round(stood.x, 2), y=round(stood.y, 2))
        self._world.warm_up()
        self._service.bus.serve(topics.TRUTH_PLACE, self._put_down)
        self._service.bus.serve(topics.TRUTH_TIME, self._set_clock)
        self._service.thread(self._drive, "base")
        self._service.ready()
        self._see()

    def _at_rest(self) -> BaseState | None:
        """Where the robot stood: the base's own time-out has stopped it while this process was away."""
        stood = self._place.load()
        if stood is None:
            return None
        stood = replace(stood, wheel_v=0.0, wheel_w=0.0)
        self._place.save(stood)
        return stood

    def _put_down(self, place: m.Place) -> m.Done:
        with self._lock:
            self._world.place(place.x, place.y, place.yaw)
        return m.Done(text="the robot was put down")

    def _set_clock(self, moment: m.WorldTime) -> m.Done:
        """Moves the sun; answered once the shadows are computed anew.

        It takes no lock: the base drives on meanwhile, and frames keep the old light until the new one is whole.
        """
        time = datetime.fromtimestamp(moment.stamp / 1e9, UTC)
        self._world.set_time(time)
        return m.Done(text=f"it is {time:%Y-%m-%d %H:%M} UTC in the world")

    def _drive(self) -> None:
        """The base, stepped by the time that really passed."""
        period = 1.0 / self._settings.base_rate
        last = time.monotonic()
        due = last
        while not self._service.stop.is_set():
            due = max(due + period, time.monotonic() - period)
            self._service.stop.wait(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            received = self._safe.poll()
            command = None if received is None else (received.message.v, received.message.w)
            with self._lock:
                self._world.step(now - last, command)
                v, w = self._world.wheel_odometry()
                truth_v, truth_w = self._world.twist
                T_world_vehicle = self._world.T_world_vehicle
                self._place.save(self._world.base_state)
            last = now
            stamp = m.now_ns()
            self._truth.put(m.Truth(stamp=stamp, T_world_vehicle=T_world_vehicle, v=truth_v, w=truth_w))
            if PLAYER not in self._presence:
                self._odometry.put(m.WheelOdometry(stamp=stamp, v=v, w=w))

    def _see(self) -> None:
        """The camera, on a schedule of its own."""
        period = 1.0 / self._settings.frame_rate
        camera = m.CameraModel.of(self._world.camera)
        due = time.monotonic()
        while not self._service.stop.is_set():
            due = max(due + period, time.monotonic())
            self._service.stop.wait(due - time.monotonic())
            if PLAYER in self._presence:
                continue
            stamp = m.now_ns()
            with self._service.stage("render"):
                left, right = self._world.render()
            self._frames.put(m.StereoFrame(stamp=stamp, camera=camera, left=left, right=right))
