"""Brings a map from an archive into the store."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

from common.environment.metadata import Archive
from common.messages import MapSummary, SyncState, VertexRecord
from services.mapstore.archive.reading import ArchiveReader, verify
from services.mapstore.store import Store

_AT_A_TIME = 8
"""Vertices of one transaction: some 1 MB, so that a driving robot's commits wait for milliseconds."""


def import_archive(
    store: Store,
    file: Path,
    expected: Archive | None = None,
    map_id: str | None = None,
    state: SyncState = SyncState.FETCHED,
    advance: Callable[[int], None] = lambda _: None,
) -> MapSummary:
    """Verifies all of an archive, then takes it; a run that was killed is completed by another.

    Nobody sees the map before it is whole. ``advance`` hears how many vertices were taken. Returns the map as it is
    stored, also where it was there already.

    Raises:
        ArchiveError: the archive is not sound, or not the one expected; nothing was taken.
        GraphError: the store has another map of its id.
        StoreError: the disk is full, or the store cannot be written.
    """
    manifest = verify(file, expected, map_id)
    with ArchiveReader(file) as archive:
        if store.begin_arrival(manifest.map):
            vertices = archive.vertices()
            while part := list[VertexRecord](itertools.islice(vertices, _AT_A_TIME)):
                store.arrive(part)
                store.checkpoint()
                advance(part[-1].id.index + 1)
            for some in archive.edges():
                store.join_arrival(manifest.map.id, some)
            return store.finish_arrival(manifest.ends(), state)
    return store.summary(manifest.map.id)
