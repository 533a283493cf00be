"""The sensors' topics and loops: the synthetic world's frames, scans, odometry and truth out; ``command/safe`` in.

Real cameras and ROS 2 robots have a driver of their own.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime

import structlog

from common import messages as m
from common import topics
from common.service import Service
from services.sensors.cameras import CameraDriver
from services.sensors.ros2.driver import Ros2Driver
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
    if settings.driver == "cameras":
        CameraDriver(service, settings, quiet=PLAYER).run()
        return
    if settings.driver == "ros2":
        Ros2Driver(service, settings, quiet=PLAYER).run()
        return
    SyntheticDriver(service, settings).run()


class SyntheticDriver:
    """The synthetic world in real time: its base in one thread, its camera in another, its lidar in a third."""

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
        self._pairs = bus.publisher(topics.STEREO, settings.camera)
        self._images = bus.publisher(topics.CAMERA, settings.camera)
        self._scans = bus.publisher(topics.LIDAR, settings.lidar)
        self._odometry = bus.publisher(topics.WHEEL_ODOMETRY)
        self._truth = bus.publisher(topics.TRUTH)

    def run(self) -> None:
        """Starts where the robot stood, then drives, renders and scans."""
        stood = self._stood
        if stood is not None:
            self._world.restore(stood)
            log.info("the robot stands where it stood", x=round(stood.x, 2), y=round(stood.y, 2))
        self._world.warm_up(cameras=self._settings.sees, lidar=self._settings.scans)
        self._service.bus.serve(topics.TRUTH_PLACE, self._put_down)
        self._service.bus.serve(topics.TRUTH_TIME, self._set_clock)
        self._began = time.monotonic() - self._world.clock
        self._service.thread(self._drive, "base")
        if self._settings.sees:
            self._service.thread(self._see, "camera")
        if self._settings.scans:
            self._service.thread(self._spin, "lidar")
        self._service.ready()
        self._service.stop.wait()

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
        last = self._began + self._world.clock
        due = last
        while not self._service.stop.is_set():
            due = max(due + period, time.monotonic() - period)
            self._service.stop.wait(max(0.0, due - time.monotonic()))
            now, stamp = time.monotonic(), m.now_ns()
            received = self._safe.poll()
            command = None if received is None else (received.message.v, received.message.w)
            with self._lock:
                self._world.step(now - last, command)
                v, w = self._world.wheel_odometry()
                truth_v, truth_w = self._world.twist
                T_world_vehicle = self._world.T_world_vehicle
                self._place.save(self._world.base_state)
            last = now
            self._truth.put(m.Truth(stamp=stamp, T_world_vehicle=T_world_vehicle, v=truth_v, w=truth_w))
            if PLAYER not in self._presence:
                self._odometry.put(m.WheelOdometry(stamp=stamp, v=v, w=w))

    def _see(self) -> None:
        """The camera, on a schedule of its own."""
        for _ in self._when_due(self._settings.frame_rate):
            stamp = m.now_ns()
            if "stereo" not in self._settings.simulate:
                with self._service.stage("render"):
                    left = self._world.render_left()
            else:
                with self._service.stage("render"):
                    left, right = self._world.render()
                camera = m.CameraModel.of(self._world.camera)
                self._pairs.put(m.StereoFrame(stamp=stamp, camera=camera, left=left, right=right))
            if "camera" in self._settings.simulate:
                self._images.put(m.CameraFrame(stamp=stamp, image=left))

    def _spin(self) -> None:
        """The lidar, on a schedule of its own; a scan's stamp is the time of its last column."""
        lidar = self._world.lidar
        for _ in self._when_due(self._settings.world.lidar.rate):
            stamp, clock = m.now_ns(), time.monotonic() - self._began
            with self._service.stage("scan"):
                scan = self._world.scan(clock)
            self._scans.put(
                m.LidarScan(
                    stamp=stamp,
                    T_vehicle_lidar=lidar.T_vehicle_lidar,
                    ranges=scan.ranges,
                    intensities=scan.intensities,
                    elevations=lidar.elevations,
                    azimuths=lidar.azimuths,
                    offsets=lidar.times,
                )
            )

    def _when_due(self, rate: float) -> Iterator[None]:
        """Each time that a sensor of a rate, Hz, measures, until the service stops; not while a playback is there."""
        due = time.monotonic()
        while not self._service.stop.is_set():
            due = max(due + 1.0 / rate, time.monotonic())
            self._service.stop.wait(due - time.monotonic())
            if PLAYER not in self._presence:
                yield
