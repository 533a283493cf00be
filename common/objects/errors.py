"""What can go wrong with the object storage.

```
StorageError
├── StorageUnreachable   nothing answers, or not in time, or not sensibly: the same may succeed later
├── StorageDenied        wrong credentials, or no rights for this object
├── StorageMissing       there is no such object or bucket
├── StorageFull          it has no room
└── StorageUnsuitable    it does not keep a condition that the fleet relies on
```
"""

from __future__ import annotations

from common.errors import RetraverseError


class StorageError(RetraverseError):
    """Base of all of them."""


class StorageUnreachable(StorageError):
    """Nothing answers, or not in time, or not sensibly; the outcome of a write is unknown."""


class StorageDenied(StorageError):
    """The credentials are wrong, or give no right to this object."""


class StorageMissing(StorageError):
    """There is no such object or bucket."""


class StorageFull(StorageError):
    """The storage has no room."""


class StorageUnsuitable(StorageError):
    """The storage does not keep a condition that the fleet relies on."""
