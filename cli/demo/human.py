"""A human who drives by hand in the background, until told to stop."""

from __future__ import annotations

import threading

from cli.demo.driver import Driver, DriverSettings
from cli.demo.recorder import Recorder, Recording
from common import topics
from common.bus import Bus
from common.geometry import Array
from common.messages import VelocityCommand, now_ns

_PERIOD_S = 0.05


class Human:
    """Drives a route (N, 3) of x, y, yaw by looking at where the robot truly is, and stands at its end.

    Attributes:
        arrived: set at the end of the route.
    """

    def __init__(self, bus: Bus, route: Array, settings: DriverSettings) -> None:
        self.arrived = threading.Event()
        self._recorder = Recorder(bus)
        self._driver = Driver(route, settings)
        self._teleop = bus.publisher(topics.TELEOP)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._drive, name="human", daemon=True)
        self._thread.start()

    def stop(self) -> Recording:
        """Lets go of the controls; returns what was recorded meanwhile."""
        self._stop.set()
        self._thread.join()
        return self._recorder.stop()

    def _drive(self) -> None:
        while not self._stop.wait(_PERIOD_S):
            truth = self._recorder.truth()
            command = None if truth is None else self._driver.command(truth.T_world_vehicle, _PERIOD_S)
            if truth is not None and command is None:
                self.arrived.set()
            v, w = command or (0.0, 0.0)
            self._teleop.put(VelocityCommand(stamp=now_ns(), v=v, w=w))
