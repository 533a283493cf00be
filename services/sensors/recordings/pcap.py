"""UDP datagrams in a packet capture (``.pcap``), the fragments of each put together. Nothing here knows a sensor."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path

from services.sensors.recordings.images import RecordingError

_ENDIAN = {b"\xd4\xc3\xb2\xa1": "<", b"\xa1\xb2\xc3\xd4": ">", b"\x4d\x3c\xb2\xa1": "<", b"\xa1\xb2\x3c\x4d": ">"}
_LINK_HEADER = {0: 4, 1: 14, 12: 0, 101: 0, 113: 16, 228: 0, 276: 20}
"""Bytes before the IP header, by the capture's type of link."""
_UDP = 17

Part = tuple[int, int]
"""Start and end of bytes in the file."""
Datagram = tuple[int, tuple[Part, ...]]
"""The port that a datagram was sent to, and where the parts of its payload are."""


def open_capture(file: Path) -> mmap.mmap:
    """The capture's bytes, mapped.

    Raises:
        RecordingError: the file cannot be read, is empty, or is no capture.
    """
    try:
        with file.open("rb") as opened:
            mapped = mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError as error:
        raise RecordingError(f"cannot read {file} ({error.strerror}): restore it") from error
    except ValueError:
        raise RecordingError(f"{file} is empty: copy it again") from None
    if mapped[:4] not in _ENDIAN or len(mapped) < 24:
        raise RecordingError(f"{file} is no packet capture: give a .pcap file (pcapng must be converted)")
    return mapped


def datagrams(capture: mmap.mmap, file: Path) -> Iterator[Datagram]:
    """The UDP datagrams over IPv4, in the order in which they were completed.

    Raises:
        RecordingError: the capture is of a link that is not known, or is cut short.
    """
    endian = _ENDIAN[capture[:4]]
    (link,) = struct.unpack_from(endian + "I", capture, 20)
    if link not in _LINK_HEADER:
        raise RecordingError(f"{file} was captured on a link of type {link}: capture UDP over Ethernet")
    fragments: dict[tuple[bytes, int], dict[int, Part]] = {}
    at = 24
    while at < len(capture):
        if at + 16 > len(capture):
            raise RecordingError(f"{file} is truncated: copy it again")
        (length,) = struct.unpack_from(endian + "I", capture, at + 8)
        if at + 16 + length > len(capture):
            raise RecordingError(f"{file} is truncated: copy it again")
        found = _datagram(capture, at + 16 + _LINK_HEADER[link], at + 16 + length, fragments)
        if found is not None:
            yield found
        at += 16 + length


def _datagram(
    capture: mmap.mmap, start: int, end: int, fragments: dict[tuple[bytes, int], dict[int, Part]]
) -> Datagram | None:
    """The datagram that an IP packet completes, if it does; fragments are kept until then."""
    if end - start < 28 or capture[start] >> 4 != 4 or capture[start + 9] != _UDP:
        return None
    header = 4 * (capture[start] & 15)
    total, identification, flags = struct.unpack_from(">HHH", capture, start + 2)
    body = (start + header, min(start + total, end))
    offset, more = 8 * (flags & 0x1FFF), bool(flags & 0x2000)
    if offset == 0 and not more:
        return _payload(capture, {0: body})
    key = capture[start + 12 : start + 20], identification
    parts = fragments.setdefault(key, {})
    if offset == 0:
        parts.clear()
    parts[offset] = body
    if more:
        return None
    del fragments[key]
    return _payload(capture, parts)


def _payload(capture: mmap.mmap, parts: dict[int, Part]) -> Datagram | None:
    """Where the payload of a datagram is; None where a fragment is missing."""
    reached, ordered = 0, []
    for offset in sorted(parts):
        if offset != reached:
            return None
        ordered.append(parts[offset])
        reached += parts[offset][1] - parts[offset][0]
    if reached < 8:
        return None
    (port,) = struct.unpack_from(">H", capture, ordered[0][0] + 2)
    first = (ordered[0][0] + 8, ordered[0][1])
    return int(port), (first, *ordered[1:])
