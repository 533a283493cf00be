"""The attachment of a sample: schema version, sequence number, source stamp, source id and checksum."""

from __future__ import annotations

import secrets
import zlib
from typing import NamedTuple, Self

import msgpack

from common.errors import MalformedMessage
from common.topics import SCHEMA

_CHECKED_BYTES = 65536
"""Of a large payload only this much is summed: its header and what follows; a picture's noise is not worth its time."""


class Source(NamedTuple):
    """Who sends: a robot's process, in one of its lives."""

    robot: str
    process: str
    life: str

    @classmethod
    def of(cls, robot: str, process: str) -> Self:
        """A new life of a process."""
        return cls(robot, process, secrets.token_hex(4))


class Envelope(NamedTuple):
    """What travels beside a payload."""

    schema: int
    sequence: int
    stamp: int
    source: Source
    checksum: int

    @classmethod
    def seal(cls, payload: bytes | bytearray, source: Source, sequence: int, stamp: int) -> Self:
        """The envelope of a payload."""
        return cls(SCHEMA, sequence, stamp, source, _checksum(payload))

    def pack(self) -> bytes:
        """The attachment's bytes."""
        return bytes(msgpack.packb([self.schema, self.sequence, self.stamp, list(self.source), self.checksum]))

    @classmethod
    def open(cls, attachment: bytes | None, payload: bytes) -> Self:
        """The envelope of a received sample.

        Raises:
            MalformedMessage: no attachment, one of another schema, or one that does not belong to the payload.
        """
        if attachment is None:
            raise MalformedMessage("the sample carries no envelope")
        try:
            schema, sequence, stamp, names, checksum = msgpack.unpackb(attachment)
            robot, process, life = names
            envelope = cls(schema, sequence, stamp, Source(robot, process, life), checksum)
        except (ValueError, TypeError, msgpack.UnpackException):
            raise MalformedMessage("the sample's envelope cannot be read") from None
        numbers = (schema, sequence, stamp, checksum)
        if not all(type(n) is int and n >= 0 for n in numbers) or not all(
            type(name) is str for name in envelope.source
        ):
            raise MalformedMessage("the sample's envelope cannot be read")
        if envelope.schema != SCHEMA:
            raise MalformedMessage(f"the sample is of schema {envelope.schema}, this process speaks {SCHEMA}")
        if envelope.checksum != _checksum(payload):
            raise MalformedMessage("the payload does not match its checksum")
        return envelope


def _checksum(payload: bytes | bytearray) -> int:
    return zlib.crc32(memoryview(payload)[:_CHECKED_BYTES])
