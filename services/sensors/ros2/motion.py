"""The base's side: velocity commands to it; its odometry, its joystick and a person's commands from it."""

from __future__ import annotations

import threading
import time

from common import topics
from common.messages import now_ns
from services.sensors.ros2 import inputs, outputs, types
from services.sensors.ros2.command import CommandGate
from services.sensors.ros2.graph import Arrived, RosSubscription
from services.sensors.ros2.link import Link, each
from services.sensors.ros2.qos import COMMAND, DEFAULT, SENSOR_DATA, STATIC_TRANSFORMS

_LOOK_S = 0.02


class Commands:
    """``command/safe`` as the ``cmd_vel`` of the base, in a thread of its own.

    Attributes:
        commands: the sending end.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stamped = link.settings.stamped
        self._safe = link.service.bus.subscribe(topics.SAFE)
        kind = types.TWIST_STAMPED if self._stamped else types.TWIST
        self.commands = link.graph.publisher(link.settings.outputs.command, kind, COMMAND)
        self._gate = CommandGate(topics.SAFE.max_age_s)

    def run(self) -> None:
        """Passes commands on until the service stops, which stops the base."""
        while not self._link.service.stop.is_set():
            received = self._safe.wait(_LOOK_S)
            now = time.monotonic()
            if received is not None and self._gate.fresh(received.arrival, now):
                self._send(received.message.v, received.message.w)
            elif self._gate.stops(now):
                self._link.reporter.say("command/safe", "it has fallen silent, and the base is told to stop")
                self._send(0.0, 0.0)
        self._send(0.0, 0.0)

    def _send(self, v: float, w: float) -> None:
        frame = self._link.settings.frames.base
        self.commands.put(outputs.twist_stamped(v, w, now_ns(), frame) if self._stamped else outputs.twist(v, w))


class Motion:
    """Wheel odometry, joystick, a person's commands, and the vehicle's static transforms."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._wake = threading.Event()
        bus, settings = link.service.bus, link.settings
        self._odometry = bus.publisher(topics.WHEEL_ODOMETRY)
        self._joystick = bus.publisher(topics.JOYSTICK)
        self._teleop = bus.publisher(topics.TELEOP)
        teleop = types.TWIST_STAMPED if settings.teleop_stamped else types.TWIST
        wanted = (
            (settings.inputs.odometry, types.ODOMETRY, SENSOR_DATA, self._moved),
            (settings.inputs.joystick, types.JOY, SENSOR_DATA, self._pressed),
            (settings.inputs.teleop, teleop, DEFAULT, self._driven),
            (settings.inputs.static_transforms, types.TRANSFORMS, STATIC_TRANSFORMS, self._mounted),
        )
        self._heard = [
            (link.graph.subscribe(name, kind, qos, self._wake), use) for name, kind, qos, use in wanted if name
        ]
        self.steady: list[RosSubscription] = [found for found, use in self._heard if use == self._moved]

    def run(self) -> None:
        """Carries them over until the service stops."""
        for _ in self._link.looks(self._wake):
            for subscription, use in self._heard:
                each(subscription, use)

    def _moved(self, arrived: Arrived) -> None:
        odometry = inputs.wheel_odometry(arrived.message, now_ns())
        if not self._link.silent:
            self._odometry.put(odometry)
        pose = inputs.pose(arrived.message)
        if pose is not None:
            self._link.route.moved(odometry.stamp, pose)

    def _pressed(self, arrived: Arrived) -> None:
        joystick = inputs.joystick(arrived.message, self._link.settings.dead_man, now_ns())
        if not self._link.silent:
            self._joystick.put(joystick)

    def _driven(self, arrived: Arrived) -> None:
        command = inputs.velocity(arrived.message, now_ns())
        if not self._link.silent:
            self._teleop.put(command)

    def _mounted(self, arrived: Arrived) -> None:
        self._link.frames.add(arrived.message)
