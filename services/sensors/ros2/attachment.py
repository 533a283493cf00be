"""What ``rmw_zenoh`` attaches to each sample; its receivers drop a sample without one.

```
int64 sequence number | int64 source timestamp, ns | uint8 length of the gid, 16 | gid
```
Little-endian.
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass

from services.sensors.ros2.errors import RosDataError

_HEAD = struct.Struct("<qqB")
_GID_BYTES = 16


@dataclass(frozen=True, slots=True)
class Attachment:
    """Number of a sample, counted by its publisher, when it was sent (ns since the epoch), and the publisher's id."""

    sequence: int
    stamp_ns: int
    gid: bytes

    def pack(self) -> bytes:
        """The bytes of it."""
        return _HEAD.pack(self.sequence, self.stamp_ns, len(self.gid)) + self.gid

    @classmethod
    def unpack(cls, data: bytes) -> Attachment:
        """Inverse of :meth:`pack`.

        Raises:
            RosDataError: the bytes are no attachment.
        """
        if len(data) != _HEAD.size + _GID_BYTES or data[_HEAD.size - 1] != _GID_BYTES:
            raise RosDataError(f"an attachment of {len(data)} bytes is none of rmw_zenoh")
        sequence, stamp_ns, _ = _HEAD.unpack_from(data)
        return cls(sequence, stamp_ns, data[_HEAD.size :])


def gid_of(token: str) -> bytes:
    """The id of the endpoint of a liveliness token, the same for as long as the token is."""
    return hashlib.blake2b(token.encode(), digest_size=_GID_BYTES).digest()
