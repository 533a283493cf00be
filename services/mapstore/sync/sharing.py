"""One map goes up: archive, upload, and the metadata whose creation is the commit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pydantic import ValidationError

from common.environment.metadata import Archive, MapMetadata, archive_key, metadata_key, report_key
from common.errors import RetraverseError
from common.messages import MapSummary, RepeatReport, SyncState
from common.objects import ObjectStore, StorageMissing
from common.objects.multipart import upload
from services.mapstore.archive import write_archive
from services.mapstore.archive.writing import checked_sum
from services.mapstore.metadata import metadata_of
from services.mapstore.store import Store

Advance = Callable[[int, int], None]
"""Told how many bytes have gone, and of how many."""


class MapConflict(RetraverseError):
    """The storage has another map under a map's name."""


def share_map(store: Store, objects: ObjectStore, summary: MapSummary, folder: Path, advance: Advance) -> None:
    """Brings a sealed map to the fleet's storage; whatever a killed run has done is not done again.

    Raises:
        StorageError: as the storage says.
        MapConflict: it has another map of this name.
        GraphError: the map cannot be archived, for it is damaged.
        StoreError, OSError: the store cannot be read, or the archive not be written.
    """
    map_id, environment = summary.record.id, summary.record.environment
    store.set_sync(map_id, SyncState.UPLOADING)
    file = folder / f"{map_id}.zip"
    archive = checked_sum(file) if file.exists() else write_archive(store, map_id, file)
    key = archive_key(environment, map_id)
    if not _is_stored(objects, key, archive):
        upload(objects, objects.settings.maps, key, file, lambda done: advance(done, archive.bytes))
    metadata = metadata_of(store, map_id, archive)
    content = metadata.model_dump_json().encode()
    if not objects.create(objects.settings.environments, metadata_key(environment, map_id), content):
        _require_same(objects, metadata)
    store.set_sync(map_id, SyncState.SYNCED)
    forget(folder, map_id)


def share_report(store: Store, objects: ObjectStore, report: RepeatReport) -> None:
    """Brings a repeat's report to the fleet's storage.

    Raises:
        StorageError: as the storage says.
    """
    key = report_key(report.robot, report.environment, report.id)
    objects.create(objects.settings.environments, key, report.model_dump_json().encode())
    store.drop_report(report.id)


def forget(folder: Path, map_id: str) -> None:
    """Removes what an upload has kept of a map."""
    for file in folder.glob(f"{map_id}.zip*"):
        file.unlink(missing_ok=True)


def _is_stored(objects: ObjectStore, key: str, archive: Archive) -> bool:
    """Whether the storage has the archive: an upload is there whole or not at all, with every part's sum compared."""
    try:
        return objects.stat(objects.settings.maps, key).bytes == archive.bytes
    except StorageMissing:
        return False


def _require_same(objects: ObjectStore, metadata: MapMetadata) -> None:
    key = metadata_key(metadata.environment, metadata.name)
    try:
        stored = MapMetadata.model_validate_json(objects.get(objects.settings.environments, key))
    except ValidationError:
        raise MapConflict(f"the storage has something else than a map under the name {metadata.name}") from None
    if stored.archive != metadata.archive:
        raise MapConflict(f"the storage has another map under the name {metadata.name}")
