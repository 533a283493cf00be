"""The fleet's server of a demo with two robots: its processes on this machine, and what a robot needs to reach them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from cli import client
from cli.demo.configuration import ENVIRONMENT, FleetLink, config_file, free_port, write_fleet_config
from cli.demo.story import Progress
from cli.processes import FLEET as PROCESSES
from cli.supervision.supervised import Supervised
from common import topics
from common.messages import Catalog, CatalogEntry, CatalogQuery
from common.topics import FLEET

_ANSWER_S = 20.0
"""A server that has just taken a map in, and compares it with the others, may be slow to answer."""


class DemoFleet:
    """The server's processes; a context manager."""

    def __init__(self, folder: Path, robots: Sequence[str], progress: Progress) -> None:
        self._path = config_file(folder, FLEET)
        self._storage = free_port()
        write_fleet_config(self._path, folder / "data", robots, self._storage)
        self._supervised = Supervised(self._path, PROCESSES)
        self._progress = progress

    def __enter__(self) -> Self:
        self._progress("starting the fleet's server", 0.0)
        self._supervised.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._supervised.__exit__(kind, error, trace)

    def link(self, robot: str) -> FleetLink:
        """How a robot reaches the server."""
        config = self._supervised.config
        return FleetLink(
            router=config.bus.endpoint,
            storage=f"http://127.0.0.1:{self._storage}",
            credentials=config.directory / "storage" / "credentials" / f"{robot}.json",
        )

    def catalog(self) -> list[CatalogEntry]:
        """The maps that the server knows."""
        with client.connect(self._supervised.config) as bus:
            answer: Catalog = bus.ask(topics.CATALOG, CatalogQuery(environment=ENVIRONMENT), _ANSWER_S, ENVIRONMENT)
        return answer.entries
