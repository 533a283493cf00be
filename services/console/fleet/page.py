"""The fleet's page: wires what is known of the fleet to browsers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from common.environment import MODES, warm_up
from common.service import Service
from services.console.errors import UnknownAction
from services.console.fleet import told
from services.console.fleet.asked import CostsAsked, EnvironmentAsked, SimilarityAsked
from services.console.fleet.snapshot import Snapshot
from services.console.fleet.watch import Watch
from services.console.page import Page
from services.console.settings import Settings

_UNLINKED = (
    "this robot is linked to no fleet: name the fleet server's router as `fleet` in [bus] of its file, "
    "as tcp/fleet.example:7448"
)


class FleetPage(Page):
    """Robots and environments of the fleet; what maps cost, and the plans that follow."""

    name = "fleet"
    title = "Fleet"
    folder = Path(__file__).parent / "static"

    def __init__(self, service: Service, settings: Settings) -> None:
        super().__init__(service, settings)
        config = service.config
        linked = config.of_fleet or config.bus.fleet is not None
        sees_all = config.of_fleet or config.security is None  # with rights given out, a robot has none to the others
        robots = "*" if sees_all else config.robot.name
        self._watch = Watch(service.bus, service.stop, "" if linked else _UNLINKED, robots)
        self._shown: Snapshot | None = None
        self._actions: dict[str, Callable[[Mapping[str, Any]], object]] = {
            "environment": self._environment,
            "costs": self._costs,
            "similarity": self._similarity,
        }
        own = {"environment": "", "sensor": ""} if config.of_fleet else config.robot.model_dump(include=_OWN)
        self.channel.set("own", {**own, "robots": robots})
        self.channel.set("modes", {name: list(theta.values) for name, theta in MODES.items()})
        service.thread(self._follow, "fleet")

    def update(self, now: float) -> None:  # noqa: ARG002, the snapshot ages by itself
        """Shows what has changed."""
        snapshot = self._watch.snapshot
        if snapshot is not self._shown:
            self._shown = snapshot
            self.channel.set("fleet", told.fleet_told(snapshot))
            self.channel.set("robots", told.robots_told(snapshot))
            self.channel.set("versions", {name: one.version for name, one in snapshot.environments.items()})

    def act(self, action: str, arguments: Mapping[str, Any]) -> object:
        """Tells a browser what it asks for.

        Raises:
            RetraverseError: it asks for something wrong, or the fleet does not tell it.
        """
        if action not in self._actions:
            raise UnknownAction(f"the page '{self.name}' knows no '{action}'")
        with self.service.stage(action):
            return self._actions[action](arguments)

    def _follow(self) -> None:
        warm_up()  # or else the first browser would wait for it
        self._watch.run(self._watched)

    def _watched(self) -> bool:
        return self.channel.watchers > 0

    def _environment(self, arguments: Mapping[str, Any]) -> object:
        asked = EnvironmentAsked.of(arguments)
        return told.environment_told(self._watch.look(asked.environment), asked.sensor)

    def _costs(self, arguments: Mapping[str, Any]) -> object:
        asked = CostsAsked.of(arguments)
        return told.costs_told(self._watch.look(asked.environment), asked.sensor, asked.question(), asked.curves)

    def _similarity(self, arguments: Mapping[str, Any]) -> object:
        asked = SimilarityAsked.of(arguments)
        route = (asked.start, asked.end) if asked.start and asked.end else None
        return told.similarity_told(self._watch.similarities(asked.environment, route), asked.start, asked.end)


_OWN = {"environment", "sensor"}
"""Of a robot's own table: what its page shows at first."""
