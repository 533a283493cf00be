"""Listens on the bus while the robot drives, for the demo's report and for tests."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from common import topics
from common.bus import Bus
from common.geometry import Array
from common.messages import Health, Localization, State, StateName, Truth, VelocityCommand, now_ns

_MOVING_M_S = 0.02
_POLL_S = 0.002


@dataclass(slots=True)
class Recording:
    """What was heard during one drive."""

    truth: list[Truth] = field(default_factory=list)
    localizations: list[Localization] = field(default_factory=list)
    latencies_ms: list[float] = field(default_factory=list)
    health: list[Health] = field(default_factory=list)
    first_followed: float = float("inf")
    """Monotonic time (s) at which the robot began to follow a route."""
    final_state: str = ""
    final_reason: str = ""

    def _driving(self) -> slice:
        """From the first truth in motion to the last."""
        moving = np.flatnonzero([abs(t.v) > _MOVING_M_S for t in self.truth])
        return slice(moving[0], moving[-1] + 1) if len(moving) else slice(0, len(self.truth))

    def drove(self) -> bool:
        """Whether the robot moved at all."""
        return any(abs(t.v) > _MOVING_M_S for t in self.truth)

    def poses(self) -> Array:
        """True poses ``T_world_vehicle`` (N, 4, 4) from the first motion to the last."""
        return np.array([t.T_world_vehicle for t in self.truth[self._driving()]])

    def driven_metres(self) -> float:
        """Length of the driven path."""
        return float(np.linalg.norm(np.diff(self.poses()[:, :3, 3], axis=0), axis=1).sum())

    def driving_seconds(self) -> float:
        """From the first motion to the last."""
        driving = self.truth[self._driving()]
        return (driving[-1].stamp - driving[0].stamp) / 1e9

    def localization_figures(self) -> dict[str, float]:
        """Localizations a second while driving, the part of frames localized, and most metres without one."""
        rows = self._localized_driving()
        good = sum(row.success for row in rows)
        return {
            "rate_hz": round(good / self.driving_seconds(), 2),
            "success": round(good / max(len(rows), 1), 4),
            "frames": len(rows),
            "longest_dead_reckoning_m": round(max((row.metres_since_success for row in rows), default=0.0), 2),
        }

    def stream_shares(self) -> dict[str, float]:
        """The part of the localized frames that each stream of images localized."""
        streams = [row.stream for row in self._localized_driving() if row.success]
        return {name: round(streams.count(name) / len(streams), 4) for name in sorted(set(streams), reverse=True)}

    def _localized_driving(self) -> list[Localization]:
        """What was localized, or not, from the first motion to the last."""
        driving = self.truth[self._driving()]
        return [row for row in self.localizations if driving[0].stamp <= row.stamp <= driving[-1].stamp]

    def latency_figures(self) -> dict[str, float]:
        """From a frame's stamp to the first ``command/safe`` that follows from it, milliseconds."""
        p50, p99 = np.percentile(self.latencies_ms or [float("nan")], [50, 99])
        return {"p50": round(float(p50), 1), "p99": round(float(p99), 1)}

    def process_figures(self) -> dict[str, dict[str, Any]]:
        """CPU (fraction of a core), memory and the stage that takes most time, of each process."""
        figures = {}
        for name in sorted({row.process for row in self.health}):
            rows = [row for row in self.health if row.process == name]
            stages = rows[-1].stages
            main = max(stages, key=lambda stage: stages[stage].count * stages[stage].p50, default="")
            figures[name] = {
                "cpu": round(float(np.mean([row.cpu for row in rows])), 3),
                "memory_mb": round(rows[-1].memory_mb, 1),
                "stage": main,
                "p50_ms": stages[main].p50 if main else 0.0,
                "p99_ms": stages[main].p99 if main else 0.0,
            }
        return figures


class Recorder:
    """Fills a :class:`Recording` from its start to its stop."""

    def __init__(self, bus: Bus) -> None:
        self.recording = Recording()
        self._wake = threading.Event()
        self._done = threading.Event()
        self._truth = bus.subscribe(topics.TRUTH, wake=self._wake)
        self._localization = bus.subscribe(topics.LOCALIZATION, wake=self._wake)
        self._safe = bus.subscribe(topics.SAFE, wake=self._wake)
        self._health = [bus.subscribe(topics.HEALTH, name) for name in _PROCESSES]
        self._state = bus.subscribe(topics.STATE, wake=self._wake)
        self._seen_frame = 0
        self._metres = 0.0
        self._worked = False
        self._thread = threading.Thread(target=self._listen, name="recorder", daemon=True)
        self._thread.start()

    def stop(self) -> Recording:
        """Ends the recording."""
        self._done.set()
        self._thread.join()
        for subscription in (self._truth, self._localization, self._safe, self._state, *self._health):
            subscription.close()
        return self.recording

    def truth(self) -> Truth | None:
        """The newest truth."""
        return self.recording.truth[-1] if self.recording.truth else None

    def arclength(self) -> float:
        """Metres driven so far."""
        return self._metres

    def began(self) -> bool:
        """Whether the robot has been at work since the recording began."""
        return self._worked

    def state(self) -> State | None:
        """The newest state of the navigator."""
        received = self._state.last()
        return None if received is None else received.message

    def _listen(self) -> None:
        while not self._done.is_set():
            self._wake.wait(_POLL_S)
            self._wake.clear()
            recording = self.recording
            while (received := self._truth.poll()) is not None:
                self._take_truth(received.message)
            while (received := self._state.poll()) is not None:
                name = received.message.name
                self._worked = self._worked or name not in (StateName.IDLE, StateName.PAUSED)
                if name is StateName.REPEAT_FOLLOW:
                    recording.first_followed = min(recording.first_followed, received.arrival)
            while (received := self._localization.poll()) is not None:
                recording.localizations.append(received.message)
            while (received := self._safe.poll()) is not None:
                self._take_command(received.message)
            for health in self._health:
                while (received := health.poll()) is not None:
                    recording.health.append(received.message)
        state = self.state()
        if state is not None:
            self.recording.final_state, self.recording.final_reason = state.name, state.reason

    def _take_truth(self, truth: Truth) -> None:
        if self.recording.truth:
            step = truth.T_world_vehicle[:3, 3] - self.recording.truth[-1].T_world_vehicle[:3, 3]
            self._metres += float(np.linalg.norm(step))
        self.recording.truth.append(truth)

    def _take_command(self, command: VelocityCommand) -> None:
        if command.frame_stamp > self._seen_frame:
            self._seen_frame = command.frame_stamp
            self.recording.latencies_ms.append((now_ns() - command.frame_stamp) / 1e6)


_PROCESSES = ("router", "sensors", "estimator", "planner", "tracker", "safety", "navigator", "mapstore")
