"""One map comes down: its metadata, its archive, room for it, and its import once all of it was verified."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path

from pydantic import ValidationError

from common.environment.metadata import MapMetadata, archive_key, metadata_key
from common.errors import RetraverseError
from common.messages import MapSummary
from common.objects import ObjectStore
from services.mapstore.archive import ArchiveError, import_archive
from services.mapstore.store import Store
from services.mapstore.sync.sharing import Advance

_TRIES = 2
"""An archive that is spoilt is fetched once more from its beginning, for the way may have spoilt it."""


class NotFetched(RetraverseError):
    """A map that the storage has not, or not soundly, or that has no room here."""


def fetch_map(
    store: Store,
    objects: ObjectStore,
    environment: str,
    map_id: str,
    folder: Path,
    make_room: Callable[[int], None],
    advance: Advance,
) -> MapSummary:
    """Brings a map from the fleet's storage into the store; a run that was killed is gone on with.

    Raises:
        StorageError: as the storage says; there is no such map, for instance.
        NotFetched: its metadata is wrong, its archive spoilt in the storage, or there is no room.
        StoreError, OSError: the store or the disk cannot be written.
    """
    metadata = read_metadata(objects, environment, map_id)
    file = folder / f"{map_id}.part"
    folder.mkdir(parents=True, exist_ok=True)
    make_room(metadata.archive.bytes)
    for attempt in range(_TRIES):
        objects.download(
            objects.settings.maps,
            archive_key(environment, map_id),
            file,
            lambda done: advance(done, metadata.archive.bytes),
        )
        try:
            summary = import_archive(store, file, metadata.archive, map_id)
        except ArchiveError as error:
            file.unlink(missing_ok=True)
            if attempt + 1 == _TRIES:
                raise NotFetched(f"map {map_id} is spoilt in the fleet's storage: {error}") from None
        else:
            file.unlink(missing_ok=True)
            return summary
    raise NotFetched(f"map {map_id} was not fetched")


def read_metadata(objects: ObjectStore, environment: str, map_id: str) -> MapMetadata:
    """The metadata of a map in the storage.

    Raises:
        StorageError: as the storage says.
        NotFetched: it is none of that map.
    """
    key = metadata_key(environment, map_id)
    try:
        found = MapMetadata.model_validate_json(objects.get(objects.settings.environments, key))
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise NotFetched(f"the metadata of map {map_id} is wrong at '{place}': {first['msg']}") from None
    if (found.name, found.environment) != (map_id, environment):
        raise NotFetched(f"the metadata of map {map_id} is that of {found.name} in '{found.environment}'")
    return found


def make_room(store: Store, needed: int, quota: int, in_use: Collection[str]) -> None:
    """Removes maps that the storage has until ``needed`` bytes more stay within ``quota`` (0: no limit).

    The one that was used longest ago goes first; none that is in use, and none that only this robot has.

    Raises:
        NotFetched: that is not enough.
    """
    if quota == 0:
        return
    _, _, stored = store.counts()
    for summary in store.removable():
        if stored + needed <= quota:
            return
        if summary.record.id not in in_use:
            store.make_room(summary.record.id)
            stored -= summary.bytes
    if stored + needed > quota:
        raise NotFetched(
            f"{needed / 1e6:.0f} MB more do not fit: {stored / 1e6:.0f} MB of maps that cannot leave are kept, and "
            f"'quota_mb' is {quota / 1e6:.0f}"
        )
