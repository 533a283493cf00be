"""The parts of each robot that are not the subject: a base, an estimator that commits vertices, and who drives.

``python -m bench.bad_network.agent FOLDER`` runs those of all robots until the file ``stop`` is in the folder, and
writes what happened as lines of JSON with monotonic times: each commit that was answered, each change between motion
and rest, and for the end, when every map was shared.
"""

from __future__ import annotations

import json
import sys
import threading
import time
import zlib
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np

from bench.bad_network.plan import Plan
from bench.bad_network.site import ENVIRONMENT
from common import geometry, topics, wire
from common.bus import Bus
from common.errors import RetraverseError
from common.ids import VertexId
from common.messages import (
    Command,
    Commit,
    EdgeRecord,
    GraphQuery,
    Keyframe,
    Localization,
    MapList,
    MapRecord,
    Odometry,
    State,
    StateName,
    SyncState,
    VelocityCommand,
    VertexRecord,
    covariance_of,
    now_ns,
)

SPEED = 0.5
VERTEX_M, VERTICES = 0.4, 25
KEYFRAME_BYTES = 6000
_TICK_S, _ESTIMATE_S = 0.05, 0.1
_BASE_STOPS_S = 0.3
_ASK_S = 3.0
_COVARIANCE = covariance_of([1e-4] * 6)


class Log:
    """Lines of JSON; any thread may write."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream, self._lock = stream, threading.Lock()

    def write(self, kind: str, robot: str, **fields: Any) -> None:  # noqa: ANN401, what JSON holds
        """A line with the present monotonic time."""
        with self._lock:
            self._stream.write(json.dumps({"t": time.monotonic(), "kind": kind, "robot": robot, **fields}) + "\n")
            self._stream.flush()


class Robot:
    """One robot's base, estimator and operator on the spot."""

    def __init__(self, name: str, folder: Path, log: Log, stop: threading.Event) -> None:
        endpoint = f"unixsock-stream/{folder}/{name}.sock"
        self.name, self._log, self._stop = name, log, stop
        self._estimator = Bus(name, "estimator", endpoint, shared_memory=False)
        self._base = Bus(name, "sensors", endpoint, shared_memory=False)
        self._operator = Bus(name, "operator", endpoint, shared_memory=False)
        self._safe = self._base.subscribe(topics.SAFE)
        self._state = self._base.subscribe(topics.STATE)
        self._teleop = self._base.publisher(topics.TELEOP)
        self._odometry = self._estimator.publisher(topics.ODOMETRY)
        self._localization = self._estimator.publisher(topics.LOCALIZATION)
        self.driven, self._moving = 0.0, False
        self._last: VertexId | None = None
        self.finishing = threading.Event()
        self._estimator.present()
        self._base.present()
        self._threads = [
            threading.Thread(target=run, daemon=True) for run in (self._drive, self._estimate, self._teach)
        ]

    def start(self) -> None:
        """Begins to drive, and to teach one map after the other."""
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        """Waits for the end of all of it, and leaves the bus."""
        for thread in self._threads:
            thread.join()
        for bus in (self._estimator, self._base, self._operator):
            bus.close()

    def state(self) -> State | None:
        """The navigator's, unless it is stale."""
        found: State | None = self._state.fresh()
        return found

    def _drive(self) -> None:
        before = time.monotonic()
        while not self._stop.wait(_TICK_S):
            now = time.monotonic()
            safe = self._safe.last()
            v = safe.message.v if safe is not None and now - safe.arrival < _BASE_STOPS_S else 0.0
            self.driven += v * (now - before)
            before = now
            if (v > 0.0) != self._moving:
                self._moving = v > 0.0
                self._log.write("moves" if self._moving else "rests", self.name)
            state = self.state()
            wanted = SPEED if state is not None and state.name is StateName.TEACH_BRANCH else 0.0
            self._teleop.put(VelocityCommand(stamp=now_ns(), v=wanted, w=0.0))

    def _estimate(self) -> None:
        while not self._stop.wait(_ESTIMATE_S):
            stamp = now_ns()
            fields: dict[str, Any] = {"covariance": _COVARIANCE, "success": True, "inliers": 100}
            pose, still = geometry.from_xy_yaw(0, 0, 0), np.zeros(6)
            self._odometry.put(Odometry(stamp=stamp, vertex=self._last, T_vertex_robot=pose, twist=still, **fields))
            state = self.state()
            if state is not None and state.name is StateName.TEACH_METRIC_LOCALIZE and state.target is not None:
                self._localization.put(
                    Localization(
                        stamp=stamp, route="", trunk=state.target, trunk_index=0, T_trunk_robot=pose, stream="plain",
                        metres_since_success=0.0, seconds_since_success=0.0, **fields,
                    )
                )  # fmt: skip

    # --- maps --------------------------------------------------------------------------------------------------------

    def _teach(self) -> None:
        number = 0
        while not self._stop.is_set():
            state = self.state()
            if state is None:
                self._stop.wait(_TICK_S)
            elif state.name is StateName.IDLE and not self.finishing.is_set():
                self._order(Command(action="teach", vertex=self._last, start_place=f"{self.name}-{number}"))
                self._stop.wait(_ESTIMATE_S)
            elif state.name is StateName.TEACH_BRANCH and state.map is not None:
                self._record(state.map)
                number += 1
                self._finish(state.map, f"{self.name}-{number}")
            else:
                self._stop.wait(_TICK_S)

    def _record(self, record: MapRecord) -> None:
        """Commits a vertex for every stretch that is driven, until the map is long enough or the run ends."""
        before, begun = self._last, self.driven
        for index in range(VERTICES):
            while self.driven - begun < index * VERTEX_M:
                if self._stop.wait(_TICK_S) or (self.finishing.is_set() and index > 1):
                    return
            vertex = VertexId(record.id, index)
            if index == 0:
                edges = [] if before is None else [_edge("spatial", before, vertex, 0.0)]
            else:
                edges = [_edge("temporal", VertexId(record.id, index - 1), vertex, VERTEX_M)]
            keyframe = _keyframe(record.id, index)
            made = VertexRecord(id=vertex, stamp=now_ns(), keyframe=keyframe)
            self._commit(Commit(map=record if index == 0 else None, vertex=made, edges=edges))
            self._log.write("commit", self.name, map=record.id, index=index, crc=crc_of(keyframe))
            self._last = vertex

    def _finish(self, record: MapRecord, place: str) -> None:
        """Ends the map at the navigator and in the store; a robot that is paused goes on first."""
        done = threading.Event()

        def ordered() -> None:
            while not done.is_set() and not self._stop.is_set():
                state = self.state()
                if state is not None and (state.map is None or state.map.id != record.id):
                    return
                if state is not None and state.name is StateName.TEACH_BRANCH:
                    self._order(Command(action="finish", end_place=place), 15.0)
                self._stop.wait(_ESTIMATE_S)

        order = threading.Thread(target=ordered, daemon=True)
        order.start()
        while order.is_alive() and not self._stop.is_set():
            state = self.state()
            if state is not None and (state.map is None or state.map.id != record.id):
                break
            self._stop.wait(_TICK_S)
        self._commit(Commit(finished=record.id))
        self._log.write("finished", self.name, map=record.id)
        order.join()

    def _commit(self, commit: Commit) -> None:
        """As the estimator does: again and again until it is answered."""
        while not self._stop.is_set():
            try:
                self._estimator.ask(topics.COMMIT, commit, _ASK_S)
            except RetraverseError as error:
                self._log.write("unanswered", self.name, error=str(error))
                continue
            return

    def _order(self, command: Command, timeout: float = 5.0) -> None:
        try:
            self._operator.ask(topics.MISSION, command, timeout)
        except RetraverseError as error:
            self._log.write("refused", self.name, action=command.action, error=str(error))

    def shared(self) -> bool:
        """Whether every map is finished, and in the fleet's storage as far as this robot knows."""
        try:
            found: MapList = self._operator.ask(topics.MAPS, GraphQuery(environment=ENVIRONMENT), _ASK_S)
        except RetraverseError:
            return False
        own = [m for m in found.maps if m.record.robot == self.name]
        return all(m.finished and m.sync is SyncState.SYNCED for m in own)


def crc_of(keyframe: Keyframe) -> int:
    """By which a keyframe is told from any other, wherever it is stored."""
    return zlib.crc32(wire.encode(keyframe))


def _keyframe(map_id: str, index: int) -> Keyframe:
    random = np.random.default_rng([zlib.crc32(map_id.encode()), index])
    noise = random.integers(0, 256, KEYFRAME_BYTES, dtype=np.uint8)
    picture = cv2.resize(random.integers(0, 256, (6, 10), dtype=np.uint8), (160, 100))
    thumbnail = bytes(cv2.imencode(".jpg", picture)[1])
    return Keyframe(pipeline="stereo", arrays={"plain/descriptors": noise}, thumbnail=thumbnail)


def _edge(kind: Any, a: VertexId, b: VertexId, metres: float) -> EdgeRecord:  # noqa: ANN401, a literal
    return EdgeRecord(kind=kind, a=a, b=b, T_a_b=geometry.from_xy_yaw(metres, 0, 0), covariance=_COVARIANCE)


def main() -> None:
    """Drives until the plan's end, then waits until all is shared or the folder has a file ``stop``."""
    folder = Path(sys.argv[1])
    plan = Plan.parse((folder / "plan.json").read_text(encoding="utf-8"))
    stop = threading.Event()
    with (folder / "agent.jsonl").open("w", encoding="utf-8") as stream:
        log = Log(stream)
        robots = [Robot(name, folder, log, stop) for name in plan.robots]
        for robot in robots:
            robot.start()
        while time.monotonic() < plan.start + plan.seconds:
            time.sleep(0.1)
        for robot in robots:
            robot.finishing.set()
        waiting = list(robots)
        while not (folder / "stop").exists():
            for robot in [robot for robot in waiting if robot.shared()]:
                state = robot.state()
                if state is not None and state.name is StateName.IDLE:
                    log.write("shared", robot.name)
                    waiting.remove(robot)
            time.sleep(0.2)
        stop.set()
        for robot in robots:
            robot.end()
            log.write("driven", robot.name, metres=robot.driven)


if __name__ == "__main__":
    main()
