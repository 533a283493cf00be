"""A robot's store with a taught map and a repeat of it, a second robot's empty store, and archives of both maps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from common.environment.metadata import Archive
from common.messages import Commit, MapEnds
from services.mapstore.archive import write_archive
from services.mapstore.settings import Settings
from services.mapstore.store import Store
from tests.services.mapstore.graphs import drive, map_id, spatial, vertex_id

SETTINGS = Settings(lock_timeout_s=0.05, checkpoint_mb=0.3, reserve_mb=0)
TAUGHT, REPEATED = 0, 1


@dataclass(frozen=True)
class Archived:
    """An archive's file, and its size and sum."""

    file: Path
    archive: Archive


@pytest.fixture
def other(tmp_path: Path) -> Iterator[Store]:
    """The store of a robot that was never there."""
    store = Store(tmp_path / "other" / "maps.sqlite", SETTINGS)
    yield store
    store.close()


@pytest.fixture
def driven(store: Store) -> Store:
    """A taught map of 6 vertices from barn to gate, and a repeat of 5 that is joined to it at four."""
    for commit in [*drive(TAUGHT, 6), *drive(REPEATED, 5, generation=1)]:
        store.commit(commit)
    for index in range(4):
        store.commit(Commit(edges=[spatial(vertex_id(TAUGHT, index), vertex_id(REPEATED, index))]))
    store.ends(MapEnds(map=map_id(TAUGHT), start_place="barn", end_place="gate"))
    store.ends(MapEnds(map=map_id(REPEATED), start_place="barn"))
    return store


@pytest.fixture
def taught(driven: Store, tmp_path: Path) -> Archived:
    file = tmp_path / "taught.zip"
    return Archived(file, write_archive(driven, map_id(TAUGHT), file))


@pytest.fixture
def repeated(driven: Store, tmp_path: Path) -> Archived:
    file = tmp_path / "repeated.zip"
    return Archived(file, write_archive(driven, map_id(REPEATED), file))
