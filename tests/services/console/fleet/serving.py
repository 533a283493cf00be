"""The fleet's server as ``vtr fleet up`` starts it, with its storage and its console, and robots that share maps."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from pathlib import Path

from cli import client
from cli.demo.configuration import config_file
from cli.demo.fleet import DemoFleet
from common import config, topics
from common.environment.metadata import MapMetadata
from common.errors import Unavailable
from common.messages import Announcement, FleetQuery
from common.objects import ObjectStore, StorageSettings
from common.objects.settings import read_credentials
from common.topics import FLEET
from tests.processes import eventually
from tests.services.console.fleet import farm

ROBOTS = ("r1", "r2", "r3")


class Serving(DemoFleet):
    """All processes of a fleet's server, in a folder."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, ROBOTS, lambda _text, _part: None)
        self.config = config_file(folder, FLEET)
        self._tables = tomllib.loads(self.config.read_text(encoding="utf-8"))

    @property
    def page(self) -> str:
        """The address of the fleet's page."""
        return f"http://127.0.0.1:{self._tables['console']['port']}/fleet"

    @property
    def router(self) -> str:
        """Where the server's router listens."""
        return self._tables["bus"]["endpoint"]

    def share(self, maps: Iterable[MapMetadata]) -> None:
        """Commits and announces maps as their robots do, and waits until all are compared and a model is made."""
        with client.connect(config.load(self.config)) as bus:
            for one in maps:
                farm.share(self._store(one.robot), one)
                told = Announcement(environment=one.environment, robot=one.robot, map=one.name)
                bus.ask(topics.ANNOUNCE, told, name=one.environment)

            def settled() -> bool:
                try:
                    found = bus.ask(topics.ENVIRONMENTS, FleetQuery())
                except Unavailable:
                    return False  # it has just begun, and reads its storage
                return found.maps.get(farm.ENVIRONMENT, 0) > 0 and not any(found.pending.values())

            eventually(settled, "all maps are compared", 60)

    def _store(self, robot: str) -> ObjectStore:
        """The storage, with a robot's rights."""
        link = self.link(robot)
        settings = StorageSettings(endpoint=link.storage, credentials=link.credentials)
        return ObjectStore(settings, read_credentials(link.credentials))
