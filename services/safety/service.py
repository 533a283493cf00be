"""The safety monitor on the bus: whatever else happens, ``command/safe`` at 50 Hz, and every reason for a stop."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from collections.abc import Mapping
from typing import Any

import structlog

from common import topics
from common.bus import Received
from common.errors import RetraverseError
from common.messages import (
    Done,
    Joystick,
    Localization,
    Obstacles,
    Odometry,
    SafetyCommand,
    SafetyStatus,
    State,
    StopReason,
    VelocityCommand,
    Zone,
    now_ns,
)
from common.priority import be_on_time
from common.service import Service
from services.safety import inputs as known
from services.safety.estop import EmergencyStop, LatchStoreError
from services.safety.heard import Heard, Speakers
from services.safety.inputs import MOTION_OF_STATE, CommandKind, SafetyInputs
from services.safety.lateness import Lateness
from services.safety.monitor import SafetyMonitor, SafetyOutput
from services.safety.rules import Cause, Effect, Reason
from services.safety.settings import Settings
from services.safety.stop_log import StopLog
from services.safety.waiting import Waiting

_STATUS_PERIOD_S = 1.0 / topics.SAFETY_STATUS.rate_hz
_LOG_PERIOD_S = 1.0
_WAIT_S = 0.2

NEEDED: Mapping[CommandKind, tuple[str, ...]] = {
    CommandKind.TELEOP: ("navigator", "sensors"),
    CommandKind.DESIRED: ("navigator", "sensors", "estimator", "tracker"),
}
"""Processes without which the robot does not move, by what moves it; ``player`` stands in for ``sensors``."""

log = structlog.get_logger()


class LatchNotKept(RetraverseError):
    """The emergency stop's latch could not be written."""


class PressedAgain(RetraverseError):
    """The emergency stop was latched anew while it was reset."""


def main(service: Service) -> None:
    """Guards the robot until the process is stopped."""
    be_on_time()
    safety = Safety(service)
    service.thread(safety.run, "cycle")
    service.thread(safety.keep_latch, "latch")
    service.ready()
    service.stop.wait()


class Safety:
    """The newest of every input, judged fifty times a second."""

    def __init__(self, service: Service) -> None:
        bus = service.bus
        self._service = service
        self._settings = service.config.settings("safety", Settings)
        self._monitor = SafetyMonitor(self._settings.monitor())
        self._stop = EmergencyStop(service.config.directory / "run" / "emergency_stop.json")
        self._presence, self._lives = bus.presence(), bus.lives()
        self._state: Heard[State] = self._hear(topics.STATE)
        self._odometry: Heard[Odometry] = self._hear(topics.ODOMETRY)
        self._localization: Heard[Localization] = self._hear(topics.LOCALIZATION)
        self._joystick: Heard[Joystick] = self._hear(topics.JOYSTICK)
        self._obstacles: Heard[Obstacles] = self._hear(topics.OBSTACLES)
        self._watches = "obstacles" in service.config.tables
        self._commands: dict[CommandKind, Heard[VelocityCommand]] = {
            CommandKind.DESIRED: self._hear(topics.DESIRED),
            CommandKind.TELEOP: self._hear(topics.TELEOP),
        }
        self._safe = bus.publisher(topics.SAFE)
        self._status = bus.publisher(topics.SAFETY_STATUS)
        self._status_due = 0.0
        self._last_signature: object = None
        self._last_log = 0.0
        self._stop_log = StopLog()
        self._waiting = Waiting(self._settings.period_s)
        self._unsaved = threading.Event()
        self._lateness = Lateness()
        bus.serve(topics.SAFETY_COMMAND, self._answer)

    def _hear(self, topic: topics.Topic) -> Heard[Any]:
        return Heard(self._service.bus.subscribe(topic), Speakers(self._lives, topic.max_age_s))

    def run(self) -> None:
        """Cycles on an absolute schedule: one that comes late does not move those after it."""
        period = self._settings.period_s
        due = time.monotonic()
        while not self._service.stop.wait(max(due - time.monotonic(), 0.0)):
            with self._service.stage("cycle"):
                self._cycle(time.monotonic())
            late = time.monotonic() - due
            due += period * max(int(late / period) + 1, 1)

    def _cycle(self, now: float) -> None:
        """One command, whatever happens: an error stops the robot, and never this loop."""
        try:
            command, output, passing = self._judge(now)
        except Exception as error:  # noqa: BLE001, no error may leave the robot without a command
            self._complain("a cycle failed", error)
            command, output, passing = self._halt(now, error)
        try:
            self._safe.put(command)
            self._report(now, output, passing=passing)
            self._stop_log.cycle(now, output.reasons, passing=passing)
        except Exception as error:  # noqa: BLE001, the next cycle tries again; the base stops by itself meanwhile
            self._complain("nothing can be published", error)

    def _judge(self, now: float) -> tuple[VelocityCommand, SafetyOutput, bool]:
        """The command of this cycle, why it is as it is, and whether it is one that was let through."""
        self._waiting.cycle(now)
        inputs, wanted = self._inputs(now)
        output = self._monitor.step(now, inputs)
        passing = wanted is not None and all(reason.effect is Effect.SLOW for reason in output.reasons)
        frame_stamp = wanted.message.frame_stamp if wanted is not None and passing else 0
        return VelocityCommand(stamp=now_ns(), v=output.v, w=output.w, frame_stamp=frame_stamp), output, passing

    def _halt(self, now: float, error: Exception) -> tuple[VelocityCommand, SafetyOutput, bool]:
        """At rest, and held there until a moment without a command to move, as after an emergency stop."""
        with contextlib.suppress(Exception):
            self._monitor.step(now, SafetyInputs(estop="an error in safety itself"))
        text = f"Safety itself failed ({type(error).__name__}); its log says how."
        reason = Reason(Cause.COMMAND_INVALID, Effect.EMERGENCY, text)
        return VelocityCommand(stamp=now_ns(), v=0.0, w=0.0), SafetyOutput(0.0, 0.0, (reason,), 0.0), False

    # --- in ----------------------------------------------------------------------------------------------------------

    def _inputs(self, now: float) -> tuple[SafetyInputs, Received[VelocityCommand] | None]:
        """What is known now, and the command that the state would let through."""
        self._heed_button()
        state = self._state.last()
        name = None if state is None else _dotted(state.message.name)
        motion = MOTION_OF_STATE.get(name or "")
        command = None if motion is None else self._commands[motion].last()
        odometry, joystick = self._odometry.last(), self._joystick.last()
        located, obstacles = self._located(state), self._obstacles.last()
        inputs = SafetyInputs(
            state=name,
            state_age=self._age(state, now),
            command=None if command is None or motion is None else self._judged(command, motion, now),
            odometry_age=self._age_of_news(odometry, now),
            localization_age=self._age(located, now),
            switch_held=joystick is not None and joystick.message.held,
            switch_age=self._age_of_news(joystick, now),
            metres_since_success=None if located is None else located.message.metres_since_success,
            seconds_since_success=self._seconds_since_success(located, now),
            obstacles=_in_the_way(obstacles, command, watched=self._watches),
            obstacles_age=self._age(obstacles, now),
            path_offset=None if located is None else float(located.message.T_trunk_robot[1, 3]),
            covariance=None if located is None else located.message.covariance,
            metric=located is None or located.message.metric,
            estop=self._stop.reason,
            missing=self._missing(motion),
        )
        return inputs, command

    def _age_of_news(self, received: Received[Joystick] | Received[Odometry] | None, now: float) -> float | None:
        """The age of a message with what it spent on its way.

        An operator may be far, and a link may stall; a frame may wait for an estimator that is late.
        """
        age = self._age(received, now)
        if received is None or age is None:
            return None
        sender = type(received.message), received.source
        return age + self._lateness.of(sender, received.message.stamp, received.arrival)

    def _heed_button(self) -> None:
        """Latches the emergency stop for every word that its button is pressed, and leaves the disk to a thread."""
        button = self._settings.estop_button
        words = self._joystick.news()
        if button is None or not any(word.message.buttons[button : button + 1] == [True] for word in words):
            return
        is_news = self._stop.reason is None
        self._stop.latch("the joystick's button")
        if is_news:
            self._unsaved.set()

    def keep_latch(self) -> None:
        """Writes the latch to disk when the button was pressed, so that no cycle waits for the disk."""
        while not self._service.stop.is_set():
            if not self._unsaved.wait(_WAIT_S):
                continue
            self._unsaved.clear()
            log.warning("emergency stop", reason=self._stop.reason)
            try:
                self._stop.save()
            except LatchStoreError as error:
                self._complain("the emergency stop is latched, and will be forgotten at a restart", error)

    def _located(self, state: Received[State] | None) -> Received[Localization] | None:
        """The last localization, if it is on the route that the state names, or on the shorter one before it."""
        received = self._localization.last()
        if received is None or state is None:
            return None
        if received.message.route not in {state.message.route, state.message.extends or state.message.route}:
            return None
        return received

    def _missing(self, motion: CommandKind | None) -> tuple[str, ...]:
        present = self._presence.alive()
        if "player" in present:
            present |= {"sensors"}
        return tuple(name for name in NEEDED[motion] if name not in present) if motion is not None else ()

    def _age(self, received: Received[Any] | None, now: float) -> float | None:
        return None if received is None else now - received.arrival + self._waiting.seconds(received.arrival)

    def _judged(self, command: Received[VelocityCommand], kind: CommandKind, now: float) -> known.VelocityCommand:
        age = now - command.arrival + self._waiting.seconds(command.arrival)
        return known.VelocityCommand(command.message.v, command.message.w, kind, age)

    def _seconds_since_success(self, located: Received[Localization] | None, now: float) -> float | None:
        """What the estimator said, brought up to now."""
        age = self._age(located, now)
        return None if located is None or age is None else located.message.seconds_since_success + age

    # --- out ---------------------------------------------------------------------------------------------------------

    def _report(self, now: float, output: SafetyOutput, *, passing: bool) -> None:
        """Publishes the status on change and ten times a second; the figures in its sentences are no change."""
        latched = self._stop.reason is not None
        signature = (passing, latched, tuple((reason.cause, reason.effect) for reason in output.reasons))
        if signature == self._last_signature and now < self._status_due:
            return
        self._last_signature = signature
        self._status_due = max(self._status_due + _STATUS_PERIOD_S, now)
        reasons = [StopReason(rule=reason.cause.value, text=reason.sentence) for reason in output.reasons]
        self._status.put(
            SafetyStatus(stamp=now_ns(), passing=passing, scale=output.scale, latched=latched, reasons=reasons)
        )

    def _complain(self, what: str, error: Exception) -> None:
        """Logs an error, at most once a second."""
        now = time.monotonic()
        if now >= self._last_log + _LOG_PERIOD_S:
            self._last_log = now
            log.error(what, exc_info=error)

    # --- the operator ------------------------------------------------------------------------------------------------

    def _answer(self, command: SafetyCommand) -> Done:
        try:
            if command.action == "stop":
                self._stop.engage(command.reason or "by the operator")
                log.warning("emergency stop", reason=self._stop.reason)
                return Done(text="the emergency stop is latched")
            if not self._stop.reset():
                raise PressedAgain(f"the emergency stop was pressed again: {self._stop.reason}")
        except LatchStoreError as error:
            raise LatchNotKept(str(error)) from None
        log.warning("emergency stop reset")
        return Done(text="the emergency stop is reset; the robot stays at rest until it is told to move")


def _dotted(name: str) -> str:
    """``Repeat.MetricLocalize`` as the rules write it: ``repeat.metric_localize``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


def _in_the_way(
    obstacles: Received[Obstacles] | None, command: Received[VelocityCommand] | None, *, watched: bool
) -> Zone | None:
    """What lies where a command leads: ahead, behind, for a turn on the spot on either side, and nothing for none."""
    if not watched:
        return None
    if obstacles is None:
        return Zone.CLEAR
    ahead, behind = obstacles.message.ahead, obstacles.message.behind
    v, w = (0.0, 0.0) if command is None else (command.message.v, command.message.w)
    if v == 0.0:
        return Zone.CLEAR if w == 0.0 else max(ahead, behind, key=list(Zone).index)
    return ahead if v > 0.0 else behind
