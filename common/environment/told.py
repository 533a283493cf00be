"""What the fleet tells of an environment, as messages, in the terms of costs and plans."""

from __future__ import annotations

from common.environment.metadata import time_of
from common.environment.model import MapEntry, Model
from common.messages import CatalogEntry, EnvironmentModel


def model_told(message: EnvironmentModel | None) -> Model:
    """The parameters of (3.1) and (3.2); without a message, those of an environment of which nothing is known."""
    if message is None:
        return Model()
    return Model(
        periods_hours=tuple(message.periods_hours),
        weights=tuple(message.weights),
        phases=tuple(message.phases),
        trend_per_hour=message.trend_per_hour,
    )


def map_told(entry: CatalogEntry) -> MapEntry:
    """A shared map as an edge between two places."""
    return MapEntry(
        name=entry.map,
        start=entry.start,
        end=entry.end,
        timestamp=time_of(entry.stamp),
        length=entry.length,
        generation=entry.generation,
        trouble=tuple(entry.trouble),
    )
