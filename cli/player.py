"""Plays a recording on a robot's bus: its frames in the sensors' place, and a teach around them if asked for."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from cli.errors import CommandError
from cli.operator import LONG_DEADLINE_S, order
from common import topics
from common.bus import Bus
from common.errors import RetraverseError
from common.messages import CameraModel, Command, State, StateName, StereoFrame, now_ns
from services.sensors.recordings import StereoPair, StereoRecording

PROCESS = "player"
"""Its name on the bus; while it is present the sensors service is silent."""

_FIRST_ANSWER_S = 120.0
"""The estimator prepares for a camera that it has not met before."""

_ANSWER_S = 10.0
_AGAIN_S = 2.0
_STATE_S = 10.0
_POLL_S = 0.1

OnFrame = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Played:
    """What was played: frames, seconds that took, the map taught if any, and the navigator's answer."""

    frames: int
    seconds: float
    map: str | None = None
    text: str = ""


class Player:
    """A recording's way to the bus."""

    def __init__(self, bus: Bus, recording: StereoRecording, camera: str, rate: float) -> None:
        """``camera`` is the name in the topic, ``rate`` 1 for the recorded speed."""
        self._bus = bus
        self._recording = recording
        self._camera = CameraModel.of(recording.camera)
        self._rate = rate
        self._frames = bus.publisher(topics.STEREO, camera)
        self._odometry = bus.subscribe(topics.ODOMETRY)
        self._states = bus.subscribe(topics.STATE)
        bus.present()

    def play(self, on_frame: OnFrame) -> Played:
        """Publishes every frame at its time, stamped now, whether anybody listens or not."""
        start = time.monotonic()
        for pair in self._on_time():
            self._publish(pair)
            on_frame()
        return Played(len(self._recording), time.monotonic() - start)

    def teach(self, command: Command, on_frame: OnFrame) -> Played:
        """Teaches the recording as a map, each frame of which the estimator has used.

        It is played at its rate, or as fast as the estimator where that is slower. Every frame is read, and the first
        one shown, before anything is begun, so that what cannot be used changes nothing.

        Raises:
            RecordingError: an image cannot be read.
            CommandError: the estimator does not answer, or the teach did not begin or was ended by somebody else; a
                map that was begun is finished as it stands.
        """
        for _ in self._recording:
            pass  # an image that cannot be read ends it here
        self._use(self._recording[0], 0, _FIRST_ANSWER_S)
        order(self._bus, command)
        try:
            taught = self._await_branch()
            start = time.monotonic()
            for index, pair in enumerate(self._on_time()):
                self._use(pair, index, _ANSWER_S)
                self._check_teaching()
                on_frame()
            seconds = time.monotonic() - start
            finish = Command(action="finish", start_place=command.start_place, end_place=command.end_place)
            answer = order(self._bus, finish, LONG_DEADLINE_S)
        except BaseException:
            with contextlib.suppress(RetraverseError):
                order(self._bus, Command(action="cancel"), LONG_DEADLINE_S)
            raise
        return Played(len(self._recording), seconds, taught, answer.text)

    def _on_time(self) -> Iterator[StereoPair]:
        """The pairs, each when it is due; a late one delays those behind it."""
        stamps = self._recording.stamps_ns
        due = time.monotonic()
        for index, pair in enumerate(self._recording):
            if index:
                due = max(time.monotonic(), due + (int(stamps[index]) - int(stamps[index - 1])) / 1e9 / self._rate)
            time.sleep(max(0.0, due - time.monotonic()))
            yield pair

    def _publish(self, pair: StereoPair) -> int:
        """Publishes a pair and returns its new stamp."""
        stamp = now_ns()
        self._frames.put(StereoFrame(stamp=stamp, camera=self._camera, left=pair.left, right=pair.right))
        return stamp

    def _use(self, pair: StereoPair, index: int, deadline: float) -> None:
        """Publishes a pair until the estimator has used it: the bus drops frames rather than delay what follows."""
        stamps: set[int] = set()
        end = time.monotonic() + deadline
        again = 0.0
        while (now := time.monotonic()) < end:
            if now >= again:
                stamps.add(self._publish(pair))
                again = now + _AGAIN_S
            received = self._odometry.wait(_POLL_S)
            if received is not None and received.message.stamp in stamps:
                return
        raise CommandError(
            f"the estimator did not use frame {index} within {deadline:.0f} s: its log and vtr ps say why"
        )

    def _await_branch(self) -> str:
        """Waits until the state is Teach.Branch, and returns the new map's id."""
        end = time.monotonic() + _STATE_S
        while time.monotonic() < end:
            state = self._state()
            if state is not None and state.name is StateName.TEACH_BRANCH and state.map is not None:
                return state.map.id
            if state is not None and state.name is StateName.TEACH_METRIC_LOCALIZE:
                raise CommandError(
                    f"the robot believes that it stands at {state.target} and would localize there first: "
                    "play the recording into an environment of its own with --environment"
                )
            time.sleep(_POLL_S)
        raise CommandError("the navigator did not begin the teach: vtr state says why")

    def _check_teaching(self) -> None:
        state = self._state()
        if state is not None and state.name is not StateName.TEACH_BRANCH:
            raise CommandError(f"the teach was interrupted: {state.reason or state.name}")

    def _state(self) -> State | None:
        received = self._states.last()
        return None if received is None else received.message
