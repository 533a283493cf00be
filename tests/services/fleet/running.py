"""The server's two threads over a storage, without a bus; and a wait until nothing is left to do."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from common import messages as m
from common.errors import RetraverseError
from services.fleet.cluster import Cluster
from services.fleet.environments import Environments
from services.fleet.settings import Settings
from tests.processes import eventually
from tests.services.fleet.shared import BEGIN, ENVIRONMENT

HOUR_NS = 3_600_000_000_000


@dataclass
class Server:
    environments: Environments
    published: list[m.EnvironmentModel] = field(default_factory=list)

    def settled(self, maps: int) -> Server:
        """Waits until an environment has so many maps, nothing of it is pending, and its model is published."""

        def done() -> bool:
            try:
                names = self.environments.names()
            except RetraverseError:
                return False
            if names.maps.get(ENVIRONMENT) != maps or any(names.pending.values()):
                return False
            return self.published[-1:] == [self.environments.state(ENVIRONMENT).model]

        eventually(done, f"{maps} maps are compared", 60.0)
        return self

    def similarities(self, **query) -> m.Similarities:
        state = self.environments.state(ENVIRONMENT)
        return state.similarities(m.SimilarityQuery(environment=ENVIRONMENT, **query))

    def plan(self, hour: float = 12.0, **others) -> m.FleetPlan:
        stamp = round(BEGIN.timestamp() * 1e9) + round(hour * HOUR_NS)
        request = {"environment": ENVIRONMENT, "start": "dock", "goal": "gate", "stamp": stamp, "sensor": "stereo"}
        asked = m.FleetPlanRequest.model_validate({**request, "theta": (1.0, 0.0, 0.0), **others})
        return self.environments.state(ENVIRONMENT).plan(asked)

    def catalog(self) -> list[m.CatalogEntry]:
        return self.environments.state(ENVIRONMENT).page(m.CatalogQuery(environment=ENVIRONMENT)).entries


@contextmanager
def running(storage, *, scheduler: str = "", scratch, **settings) -> Iterator[Server]:
    """A server over a storage, ended at the end of the block."""
    stop = threading.Event()
    table = Settings(scheduler=scheduler, **{"reconcile_s": 3600.0, **settings})
    cluster = Cluster(scheduler, 1, scratch, stop)
    published: list[m.EnvironmentModel] = []
    server = Server(Environments(storage, cluster, table, published.append, stop), published)
    threads = [threading.Thread(target=loop) for loop in (server.environments.take_in, server.environments.compare)]
    for thread in threads:
        thread.start()
    try:
        yield server
    finally:
        stop.set()
        server.environments.wake()
        for thread in threads:
            thread.join()
        cluster.close()
