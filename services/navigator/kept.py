"""What a navigator that is started anew still knows: where the robot stands, and what it was about."""

from __future__ import annotations

import threading
from pathlib import Path

import structlog

from services.navigator import position, unfinished
from services.navigator.mission import Mission
from services.navigator.position import Position
from services.navigator.unfinished import Unfinished

_PERIOD_S = 1.0

log = structlog.get_logger()


class Kept:
    """Two small files in the robot's ``run`` folder; what cannot be read or written is logged, and goes on without.

    A busy disk may hold a write up for longer than a robot drives on without a state: what changes while it drives is
    written by a thread (:meth:`run`).

    Attributes:
        position: where the robot stood when it was written last; None where that is not known.
    """

    def __init__(self, folder: Path) -> None:
        self._position_file, self._mission_file = folder / "position.json", folder / "mission.json"
        self.position: Position | None = None
        self._unfinished: Unfinished | None = None
        self._lock = threading.Lock()
        try:
            self.position = position.load(self._position_file)
        except position.PositionUnreadable as error:
            log.warning(str(error))
        self._newest = self.position
        try:
            self._unfinished = unfinished.load(self._mission_file)
        except unfinished.UnfinishedUnreadable as error:
            log.warning(str(error))

    def unfinished_mission(self, now: float) -> Mission | None:
        """The mission that was not over, paused."""
        if self._unfinished is None:
            return None
        return self._unfinished.mission(now, None if self.position is None else self.position.vertex)

    def keep_mission(self, mission: Mission) -> None:
        """Keeps what the mission is about, if that has changed: before anybody hears of it."""
        now = Unfinished.of(mission)
        if now == self._unfinished:
            return
        try:
            unfinished.save(self._mission_file, now)
        except OSError as error:
            log.warning("the mission cannot be kept", path=str(self._mission_file), reason=error.strerror)
        self._unfinished = now
        # A navigator that is started anew plans from here.
        self.keep_position(mission)
        self._write_position()

    def keep_position(self, mission: Mission) -> None:
        """Has the thread keep where the robot stands."""
        self._newest = None if mission.position is None else Position(mission.environment, mission.position)

    def run(self, stop: threading.Event) -> None:
        """Writes the newest position once a second until the service stops, and at its end."""
        while not stop.wait(_PERIOD_S):
            self._write_position()
        self._write_position()

    def _write_position(self) -> None:
        with self._lock:
            known = self._newest
            if known == self.position:
                return
            try:
                position.save(self._position_file, known)
            except OSError as error:
                log.warning("the position cannot be kept", path=str(self._position_file), reason=error.strerror)
            else:
                self.position = known
