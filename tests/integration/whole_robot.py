"""A whole robot in the synthetic world, watched from outside of its bus, and an operator who drives it."""

from __future__ import annotations

import os
import signal
import time

import numpy as np

from cli.demo.configuration import write_config
from cli.demo.driver import DriverSettings
from cli.demo.human import Human
from cli.demo.sensor import Sensor
from cli.demo.story import Story
from common import topics
from common.errors import BusError
from common.messages import GraphQuery, Place, StateName
from services.sensors.standing_place import StandingPlace
from tests.commands import command
from tests.processes import eventually

STILL_M_S = 0.02
STOOD_S = 0.1
"""A mission may go on by itself soon after what it lost is back."""


class WholeRobot:
    """A demo robot on which processes are killed; a context manager."""

    def __init__(self, folder, sensor=Sensor.STEREO, light=None, tables=""):
        self.config = folder / "robot.toml"
        write_config(self.config, folder / "data", light, sensor)
        self.config.write_text(f"{self.config.read_text()}\n{tables}")
        self._story = Story(self.config, lambda _text, _part: None)
        self._place = StandingPlace(folder / "data" / "demo" / "run" / "standing_place")

    def __enter__(self):
        self._story.__enter__()
        self.story, self.bus, self.supervised = self._story, self._story.bus, self._story.supervised
        self.route = self.story.route()
        self._presence = self.bus.presence()
        self._heard = []
        self.pace = DriverSettings(speed=1.1, acceleration=1.0)
        return self

    def __exit__(self, *error):
        self._story.__exit__(*error)

    def speed(self):
        """The speed of the simulated wheels, m/s, read beside the bus: it is there while the router is not."""
        state = self._place.load()
        return 0.0 if state is None else abs(state.wheel_v)

    def standing(self):
        """Where the robot truly is: x, y, yaw."""
        state = self._place.load()
        return np.array([state.x, state.y, state.yaw])

    def put_down(self, x, y, yaw):
        self.bus.ask(topics.TRUTH_PLACE, Place(x=float(x), y=float(y), yaw=float(yaw)), timeout=10.0)

    def command(self, action, timeout=10.0, **fields):
        return self.bus.ask(topics.MISSION, command(action, **fields), timeout=timeout)

    def states(self):
        return self.hear(topics.STATE)

    def hear(self, topic):
        """A subscription for this test: each has a thread of its own, so :meth:`calm` ends those of the test before."""
        self._heard.append(self.bus.subscribe(topic))
        return self._heard[-1]

    def pid(self, process):
        return next(row.pid for row in self.supervised.processes() if row.name == process)

    def kill(self, process):
        """``kill -9``; returns the monotonic time and the pid."""
        pid = self.pid(process)
        os.kill(pid, signal.SIGKILL)
        return time.monotonic(), pid

    def seconds_to_standstill(self, since, deadline=3.0):
        """Seconds after ``since`` at which the wheels stood still, infinite if they did not."""
        last_moving = since
        while time.monotonic() < since + deadline:
            if self.speed() > STILL_M_S:
                last_moving = time.monotonic()
            elif time.monotonic() - last_moving > STOOD_S:
                return last_moving - since
            time.sleep(0.002)
        return float("inf")

    def wait_back(self, process, old_pid, deadline=90.0):
        """Waits until a killed process is present again, under another pid."""

        def back():
            row = next((r for r in self.supervised.processes() if r.name == process), None)
            return row is not None and row.pid not in (0, None, old_pid) and row.state == "RUNNING"

        eventually(back, f"{process} runs again", deadline)
        eventually(lambda: process in self._presence, f"{process} is present again", deadline)

    def first_metres(self, metres):
        """The beginning of the world's route."""
        steps = np.linalg.norm(np.diff(self.route[:, :2], axis=0), axis=1)
        return self.route[: int(np.searchsorted(np.cumsum(steps), metres)) + 2]

    def metres_from(self, start, length):
        """A stretch of the world's route."""
        before = self.first_metres(start)
        return self.first_metres(start + length)[len(before) - 1 :]

    def soon(self, condition, what, deadline=30.0):
        """Waits for a condition; a failure tells each process's side of the story."""
        told = (topics.STATE, topics.SAFETY_STATUS, topics.TRACKER_STATUS, topics.LOCALIZATION)
        sides = [self.bus.subscribe(topic) for topic in told]
        try:
            return eventually(condition, what, deadline)
        except AssertionError as error:
            heard = (side.last() for side in sides)
            story = "\n".join(str(received.message) for received in heard if received)
            raise AssertionError(f"{error}\n{story}\nit stands at {self.standing()}") from None
        finally:
            for side in sides:
                side.close()

    def pids(self):
        """The pid of each process."""
        return {row.name: row.pid for row in self.supervised.processes()}

    def attempt(self, action, **fields):
        """Gives a command; whether it was taken. A process that is coming back may refuse it or not answer yet."""
        try:
            self.command(action, **fields)
        except BusError:
            return False
        return True

    def calm(self):
        """Leaves no mission behind, and the robot at rest."""
        while self._heard:
            self._heard.pop().close()
        states = self.states()

        def idle():
            return state_is(states, "Idle") or (self.attempt("cancel") and False)

        self.soon(idle, "the robot is idle")
        self.soon(lambda: self.speed() < STILL_M_S, "the robot stands")

    def forget_maps(self, environment="garden"):
        """Removes every map of an environment."""
        for map_id in self.vertices(environment):
            self.bus.ask(topics.REMOVE, GraphQuery(map=map_id), timeout=10.0)

    def maps(self, environment="garden"):
        """The stored maps of an environment, the oldest first."""
        return self.bus.ask(topics.MAPS, GraphQuery(environment=environment), timeout=5.0).maps

    def vertices(self, environment="garden"):
        """Vertices of each stored map of an environment, by the map's id."""
        return {found.record.id: found.vertices for found in self.maps(environment)}

    def taught(self):
        """Ids of the taught maps, the oldest first."""
        return [found.record.id for found in self.maps() if found.record.generation == 0]

    def drive_by_hand(self, route, settings=None):
        """Starts a human who drives a route until stopped."""
        return Human(self.bus, route, settings or self.pace)


def state_is(subscription, *names):
    """Whether the newest state has one of these names."""
    received = subscription.last()
    return received is not None and received.message.name in {StateName(name) for name in names}
