"""An environment of 34 maps by three robots over two weeks, whose pictures change with the time of day."""

from __future__ import annotations

from common.environment.metadata import MapMetadata, archive_key, metadata_key
from tests.services.fleet.shared import ARCHIVE, image, metadata

ENVIRONMENT = "farm"

ROUTES = {
    ("gate", "yard"): (24.0, (9.2, 33.0, 62.5, 87.1, 116.4, 139.0, 170.3, 197.9, 226.2, 255.6, 281.3)),
    ("yard", "barn"): (31.0, (9.6, 57.7, 110.1, 163.2, 210.5, 262.4)),
    ("barn", "field"): (40.0, (10.1, 85.4, 158.0, 234.9)),
    ("field", "dock"): (35.0, (10.7, 112.3, 206.8)),
    ("yard", "pond"): (28.0, (41.0, 132.6, 229.1)),
    ("pond", "dock"): (52.0, (41.6, 134.2, 203.3)),
    ("dock", "gate"): (61.0, (42.4, 136.0, 257.7)),
    ("barn", "pond"): (19.0, (208.0,)),
}
"""Metres, and the hours after the first of June at which maps were recorded."""


def maps() -> list[MapMetadata]:
    """All maps, in the order of their times."""
    drives = sorted((hours, ends, length) for ends, (length, times) in ROUTES.items() for hours in times)
    return [_map(k, hours, ends, length) for k, (hours, ends, length) in enumerate(drives)]


def share(store, one: MapMetadata) -> None:
    """Commits a map to a storage as a robot does."""
    store.put("maps", archive_key(one.environment, one.name), ARCHIVE)
    assert store.create("environments", metadata_key(one.environment, one.name), one.model_dump_json().encode())


def _map(number: int, hours: float, ends: tuple[str, str], length: float) -> MapMetadata:
    return metadata(
        hours,
        *ends,
        environment=ENVIRONMENT,
        robot=("r1", "r2", "r3")[number % 3],
        length=length * (1.0 + 0.02 * (number % 4)),
        generation=(0, 1, 0, 2, 1)[number % 5],
        images=[image(hours, distance, seed=number) for distance in (0.0, length / 2.0, length)],
    )
