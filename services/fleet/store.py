"""The server's view of the storage: what robots have committed, and the objects that it derives from that."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Final, Protocol

from common.environment.metadata import derived_key
from common.ids import MAP_ID_PATTERN, NAME_PATTERN

_NAME, _MAP = NAME_PATTERN[1:-1], MAP_ID_PATTERN[1:-1]
_COMMITTED: Final = re.compile(
    rf"robots/(?P<robot>{_NAME})/(?P<environment>{_NAME})/(?:maps/(?P<map>{_MAP})|reports/(?P<report>{_NAME}))\.json"
)

ROBOTS = "robots/"
_AT_ONCE = 8


class Storage(Protocol):
    """What is needed of the two buckets; every call raises a ``RetraverseError`` where the storage cannot be used."""

    def read(self, key: str) -> bytes | None:
        """An object of the bucket of environments, None where there is none."""

    def write(self, key: str, content: bytes) -> None:
        """Stores an object in the bucket of environments, in place of an earlier one."""

    def remove(self, key: str) -> None:
        """Removes an object of the bucket of environments, if it is there."""

    def keys(self, prefix: str) -> Iterator[str]:
        """The keys of the bucket of environments that begin so."""

    def archive_size(self, key: str) -> int | None:
        """The size of an object of the bucket of maps, bytes; None where there is none."""


@dataclass(slots=True)
class Committed:
    """The keys of what robots have committed in an environment: maps by their ids, and reports."""

    maps: dict[str, str] = field(default_factory=dict)
    reports: list[str] = field(default_factory=list)


def committed(storage: Storage) -> dict[str, Committed]:
    """What robots have committed, by environment; keys of any other form are left alone."""
    found: dict[str, Committed] = {}
    for key in storage.keys(ROBOTS):
        match = _COMMITTED.fullmatch(key)
        if match is None:
            continue
        of = found.setdefault(match["environment"], Committed())
        if match["map"] is not None:
            of.maps[match["map"]] = key
        else:
            of.reports.append(key)
    return found


class Derived:
    """The derived objects of an environment: bytes by short names, many at a time."""

    def __init__(self, storage: Storage, environment: str) -> None:
        self._storage, self._environment = storage, environment

    def key(self, name: str) -> str:
        """The whole key of an object."""
        return derived_key(self._environment, name)

    def read(self, name: str) -> bytes | None:
        """An object, None where there is none."""
        return self._storage.read(self.key(name))

    def read_all(self, names: Iterable[str]) -> list[bytes | None]:
        """Some objects, in the order of their names."""
        return together(self._storage, [self.key(name) for name in names])

    def write(self, name: str, content: bytes) -> None:
        """Stores an object, in place of an earlier one."""
        self._storage.write(self.key(name), content)

    def names(self, beginning: str) -> set[str]:
        """The names of the objects that begin so."""
        return {key.removeprefix(self.key("")) for key in self._storage.keys(self.key(beginning))}

    def clear(self) -> None:
        """Removes them all."""
        keys = list(self._storage.keys(self.key("")))
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            list(pool.map(self._storage.remove, keys))


def together(storage: Storage, keys: list[str]) -> list[bytes | None]:
    """Reads some objects of the bucket of environments, a few at a time."""
    if len(keys) < 2:
        return [storage.read(key) for key in keys]
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        return list(pool.map(storage.read, keys))


def images_name(map_id: str) -> str:
    """Where a map's images are, as they are compared."""
    return f"images/{map_id}.npz"


def row_name(map_id: str) -> str:
    """Where a map's similarities are."""
    return f"rows/{map_id}.npz"


CATALOG, FEEDBACK, MODEL, SPECTRUM = "catalog.json.z", "feedback.json.z", "model.json.z", "spectrum.npz"
