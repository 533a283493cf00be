"""The fleet's server on the bus: hears of new maps, learns, publishes the models, answers plans."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

from common import messages as m
from common import topics
from common.bus import Bus, Publisher
from common.objects import StorageSettings
from common.objects.embedded import EmbeddedSettings
from common.service import Service
from services.fleet.buckets import Buckets
from services.fleet.cluster import Cluster
from services.fleet.environments import Environments
from services.fleet.settings import Settings
from services.fleet.warm import warm

Answer = TypeVar("Answer", bound=m.Message)


def main(service: Service) -> None:
    """Serves until the service is stopped; where the storage is away, it says so and tries again."""
    settings = service.config.settings("fleet", Settings)
    storage = Buckets(_storage(service, settings))
    cluster = Cluster(settings.scheduler, settings.threads, service.config.directory / "dask", service.stop)
    environments = Environments(storage, cluster, settings, _publishing(service.bus), service.stop)
    warm()
    _serve(service, environments)
    service.thread(environments.take_in, "intake")
    service.thread(environments.compare, "comparing")
    service.ready()
    service.stop.wait()
    environments.wake()


def _serve(service: Service, environments: Environments) -> None:
    """Answers every topic of the fleet."""
    state = environments.state
    answers: dict[topics.Topic, Callable[[Any], m.Message]] = {
        topics.ANNOUNCE: environments.announce,
        topics.FLEET_PLAN: lambda request: state(request.environment).plan(request),
        topics.CATALOG: lambda query: state(query.environment).page(query),
        topics.SIMILARITY: lambda query: state(query.environment).similarities(query),
        topics.SPECTRUM: lambda query: state(query.environment).spectrum_told(),
    }
    for topic, answer in answers.items():
        service.bus.serve(topic, _timed(service, topic, answer), name="*")
    service.bus.serve(topics.ENVIRONMENTS, lambda _: environments.names())
    service.bus.serve(topics.REBUILD, lambda _: environments.rebuild())


def _timed(service: Service, topic: topics.Topic, answer: Callable[[Any], Answer]) -> Callable[[Any], Answer]:
    stage = topic.key.rpartition("/")[2]

    def handle(question: m.Message) -> Answer:
        with service.stage(stage):
            return answer(question)

    return handle


def _publishing(bus: Bus) -> Callable[[m.EnvironmentModel], None]:
    """Publishes models, each on the topic of its environment."""
    publishers: dict[str, Publisher[Any]] = {}

    def publish(model: m.EnvironmentModel) -> None:
        name = model.environment
        if name not in publishers:
            publishers[name] = bus.publisher(topics.MODEL, name)
        publishers[name].put(model)

    return publish


def _storage(service: Service, settings: Settings) -> StorageSettings:
    """The storage that is configured, else the embedded one."""
    base = service.config.path.absolute().parent
    if settings.endpoint:
        ca = None if settings.ca is None else base / settings.ca
        return replace(settings, credentials=base / settings.credentials, ca=ca)
    embedded = service.config.settings("storage", EmbeddedSettings)
    return embedded.reached(service.config.directory, base)
