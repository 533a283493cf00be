"""The two buckets, through the client of the object storage."""

from __future__ import annotations

import threading
from collections.abc import Iterator

from common.objects import ObjectStore, StorageMissing, StorageSettings
from common.objects.settings import read_credentials


class Buckets:
    """What the server reads and writes; a copy in another process opens a connection of its own.

    Every method may raise a :class:`common.objects.StorageError`, or a ``ConfigurationError`` where a process cannot
    read the credentials.
    """

    def __init__(self, settings: StorageSettings) -> None:
        self._settings = settings
        self._lock = threading.Lock()
        self._objects: ObjectStore | None = None

    def __reduce__(self) -> tuple[type[Buckets], tuple[StorageSettings]]:
        return Buckets, (self._settings,)

    def read(self, key: str) -> bytes | None:
        """An object of the bucket of environments, None where there is none."""
        try:
            return self._connected().get(self._settings.environments, key)
        except StorageMissing:
            return None

    def write(self, key: str, content: bytes) -> None:
        """Stores an object in the bucket of environments, in place of an earlier one."""
        self._connected().put(self._settings.environments, key, content)

    def remove(self, key: str) -> None:
        """Removes an object of the bucket of environments, if it is there."""
        self._connected().request("DELETE", self._settings.environments, key, allow=(404,))

    def keys(self, prefix: str) -> Iterator[str]:
        """The keys of the bucket of environments that begin so."""
        for one in self._connected().listed(self._settings.environments, prefix):
            yield one.key

    def archive_size(self, key: str) -> int | None:
        """The size of an object of the bucket of maps, bytes; None where there is none."""
        try:
            return self._connected().stat(self._settings.maps, key).bytes
        except StorageMissing:
            return None

    def _connected(self) -> ObjectStore:
        with self._lock:
            if self._objects is None:
                self._objects = ObjectStore(self._settings, read_credentials(self._settings.credentials))
            return self._objects
