"""Questions to the fleet's server, and to the map store for maps that are to come."""

from __future__ import annotations

import structlog

from common import topics
from common.bus import Bus
from common.environment import Theta
from common.errors import BusError, Refused, Unavailable
from common.messages import FetchRequest, FleetPlan, FleetPlanRequest, SyncState, SyncStatus, now_ns
from services.planner.choice import Chosen
from services.planner.memory import Memory
from services.planner.settings import Settings

log = structlog.get_logger()


class Fleet:
    """The server, as a robot's planner knows it; where no fleet is linked, nothing is asked."""

    def __init__(self, bus: Bus, memory: Memory, settings: Settings, sensor: str, *, linked: bool) -> None:
        self._bus = bus
        self._memory = memory
        self._settings = settings
        self._sensor = sensor
        self.linked = linked
        self._status = bus.subscribe(topics.SYNC_STATUS)
        self._models = bus.subscribe(topics.MODEL, "*") if linked else None

    def listen(self) -> None:
        """Takes the models that were published since the last call."""
        while self._models is not None and (received := self._models.poll()) is not None:
            self._memory.learn(received.message.environment, received.message)

    def plan(
        self, environment: str, start: str, goal: str, theta: Theta, without: list[str] | None = None
    ) -> Chosen | None:
        """The server's plan, but for the maps ``without`` which it must do; None where there is no server to ask now.

        Raises:
            Refused: the server's own sentence: there is no such place, or no such way.
        """
        if not self.linked:
            return None
        request = FleetPlanRequest(
            environment=environment,
            start=start,
            goal=goal,
            stamp=now_ns(),
            sensor=self._sensor,
            theta=theta.values,
            per_metre=self._settings.per_metre,
            without=without or [],
        )
        try:
            found: FleetPlan = self._bus.ask(topics.FLEET_PLAN, request, self._settings.fleet_timeout_s, environment)
        except Refused:
            raise
        except BusError as error:
            log.warning("planning without the fleet's server", reason=str(error))
            return None
        self._memory.learn(environment, found.model, [*found.entries, *found.alternatives])
        return Chosen([entry.map for entry in found.entries], found.why)

    def fetch(self, environment: str, missing: list[str], total: int) -> Unavailable:
        """Has the map store fetch maps; returns what to tell whoever waits for them.

        Raises:
            Refused: the store shares no maps, or one of them cannot be had.
        """
        self._bus.ask(topics.FETCH, FetchRequest(environment=environment, maps=missing), self._settings.store_timeout_s)
        received = self._status.last()
        return _progress(missing, total, None if received is None else received.message)


def _progress(missing: list[str], total: int, status: SyncStatus | None) -> Unavailable:
    """How far the fetching is, in a sentence.

    Raises:
        Refused: one of the maps cannot be fetched.
    """
    rows = [] if status is None else [row for row in status.transfers if not row.upload and row.map in missing]
    for row in rows:
        if row.state is SyncState.QUARANTINED:
            raise Refused(row.reason or f"map {row.map} cannot be fetched")
    size, done = sum(row.total for row in rows), sum(row.done for row in rows)
    share = f", {done / size:.0%} of {size / 1e6:.1f} MB" if size else ""
    waits = "" if status is None or status.online or not status.reason else f": {status.reason}"
    return Unavailable(f"fetching {len(missing)} of the plan's {total} maps{share}{waits}")
