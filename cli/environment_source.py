"""Where a sub-command of ``vtr env`` takes its environment from: a file, or the running fleet."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from cli import arguments, client, robot
from cli.errors import CommandError
from common import topics
from common.bus import Bus
from common.config import RobotConfig
from common.environment import Environment, Model, read_environment
from common.environment.told import map_told, model_told
from common.messages import CatalogEntry, CatalogQuery, EnvironmentModel, FleetQuery, SimilarityQuery
from services.fleet.similarity import SimilarityMatrix

_DEADLINE_S = 5.0
_MODEL_S = 2.0
_POLL_S = 0.02
_MOST = 2000
_NS_PER_HOUR = 3.6e12


def of_file_or_fleet(file: Path | None, name: str | None, config: Path | None) -> Environment:
    """The environment in a file, or one of the fleet that a robot or the server's own configuration leads to.

    Raises:
        CommandError: both or neither are named, or the fleet has no such environment.
        RetraverseError: the file cannot be read, or the fleet not be asked.
    """
    if file is not None:
        if name is not None:
            raise CommandError("--env names a file and --environment one of the fleet's: give one")
        return read_environment(file)
    return of_fleet(name, config)


def of_fleet(name: str | None, config: Path | None) -> Environment:
    """An environment of the running fleet: its maps, and its newest model.

    Raises:
        CommandError: the fleet has no such environment.
        RetraverseError: no configuration is named, or the fleet cannot be asked.
    """
    configuration = _configuration(config)
    with client.connect(configuration) as bus:
        chosen = _name(bus, configuration, name)
        entries = catalog(bus, chosen)
        model = _model(bus, chosen)
    return Environment(name=chosen, model=model_told(model), maps=tuple(map(map_told, entries)))


def model_of(file: Path | None, name: str | None, config: Path | None) -> tuple[str, Model | EnvironmentModel]:
    """The name of an environment and its model; that of the fleet says what it is made of, and why it is no more."""
    if file is not None:
        known = of_file_or_fleet(file, name, config)
        return known.name, known.model
    configuration = _configuration(config)
    with client.connect(configuration) as bus:
        chosen = _name(bus, configuration, name)
        found = _model(bus, chosen)
    if found is None:
        raise CommandError(f"the fleet has no model of '{chosen}' yet: maps have to be shared first")
    return chosen, found


def similarities_of_fleet(name: str | None, config: Path | None) -> SimilarityMatrix:
    """How alike the newest maps of a running fleet's environment are, of those places between which most maps lead.

    Raises:
        RetraverseError: no configuration is named, or the fleet cannot be asked, or has compared none.
    """
    configuration = _configuration(config)
    with client.connect(configuration) as bus:
        chosen = _name(bus, configuration, name)
        query = SimilarityQuery(environment=chosen, limit=_MOST)
        found = bus.ask(topics.SIMILARITY, query, _DEADLINE_S, name=chosen)
    return SimilarityMatrix(tuple(found.maps), np.array(found.stamps) / _NS_PER_HOUR, found.values)


def catalog(bus: Bus, environment: str) -> list[CatalogEntry]:
    """All shared maps of an environment that lead from a place to a place."""
    entries: list[CatalogEntry] = []
    while True:
        after = entries[-1].map if entries else None
        page = bus.ask(
            topics.CATALOG, CatalogQuery(environment=environment, after=after), _DEADLINE_S, name=environment
        )
        entries += page.entries
        if not page.more or not page.entries:
            return entries


def _configuration(config: Path | None) -> RobotConfig:
    if config is None and not robot.DEFAULT.is_file() and robot.FLEET_DEFAULT.is_file():
        config = robot.FLEET_DEFAULT
    if config is None and not robot.DEFAULT.is_file():
        raise CommandError(
            "name a file (--env, --series, --similarity), or with --config the robot or server that leads to the fleet"
        )
    return robot.load(config)


def _name(bus: Bus, configuration: RobotConfig, name: str | None) -> str:
    """The environment that is meant: the one named, the robot's, or the only one there is."""
    known = bus.ask(topics.ENVIRONMENTS, FleetQuery(), _DEADLINE_S).maps
    chosen = arguments.name(name, "--environment")
    if chosen is None:
        chosen = next(iter(known)) if configuration.of_fleet and len(known) == 1 else configuration.robot.environment
    if chosen not in known:
        listed = ", ".join(sorted(known)) or "none yet"
        raise CommandError(f"the fleet has no environment '{chosen}'; it has {listed}")
    return chosen


def _model(bus: Bus, environment: str) -> EnvironmentModel | None:
    """The model as it was published last."""
    models = bus.subscribe(topics.MODEL, environment)
    end = time.monotonic() + _MODEL_S
    while time.monotonic() < end:
        if (received := models.poll()) is not None:
            found: EnvironmentModel = received.message
            return found
        time.sleep(_POLL_S)
    return None
