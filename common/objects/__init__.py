"""Object storage: any S3, through the ``minio`` SDK, with what that lacks: conditional puts and resumable uploads."""

from common.objects.errors import (
    StorageDenied,
    StorageError,
    StorageFull,
    StorageMissing,
    StorageUnreachable,
    StorageUnsuitable,
)
from common.objects.settings import StorageSettings
from common.objects.store import ObjectStore, StoredObject

__all__ = [
    "ObjectStore",
    "StorageDenied",
    "StorageError",
    "StorageFull",
    "StorageMissing",
    "StorageSettings",
    "StorageUnreachable",
    "StorageUnsuitable",
    "StoredObject",
]
