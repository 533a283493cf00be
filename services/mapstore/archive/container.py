"""The zip file around an archive's members: stored, not compressed, with fixed times and rights, and nothing else.

A reader takes nothing but what the writer writes, byte for byte: no paths, links, encryption or compression, nothing
between the members or behind them. So a file has no room for anything that another program might run or unpack.
"""

from __future__ import annotations

import stat
import struct
import zipfile
from pathlib import Path
from types import TracebackType
from typing import IO, Final, NamedTuple, Self

from services.mapstore.archive.errors import ArchiveError
from services.mapstore.archive.manifest import LARGEST_MANIFEST, LARGEST_MEMBER, MOST_MEMBERS, NAME

_TIME: Final = (1980, 1, 1, 0, 0, 0)
_DATE: Final = 0x21
"""The same, as a zip file has it."""

_UNIX: Final = 3
_RIGHTS: Final = (stat.S_IFREG | 0o644) << 16

_END = struct.Struct("<4s4H2LH")
_LOCATOR = struct.Struct("<4sLQL")
_LARGE_END = struct.Struct("<4sQ2H2L4Q")
_ENTRY = struct.Struct("<4s4B4H3L5H2L")
_FAR = struct.Struct("<2HQ")
"""The field of an entry that holds the place of a member behind the first 4 GB."""

_ENCRYPTED = 1
_ZIP_ERRORS = (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, ValueError, struct.error, OSError)
"""What :mod:`zipfile` raises on bytes that are no zip."""

_MOST_ENTRY_BYTES = 46 + 64 + 28
"""Of the directory: the fixed part, a name, and the place of a member behind the first 4 GB."""


class _Wrong(Exception):
    """The file's form is not that of an archive."""


class Writer:
    """Writes members one after the other; the file is an archive at the end of the block."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._zip = zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Writes the directory, without which the file is no archive."""
        self._zip.close()

    def add(self, name: str, content: bytes) -> None:
        """Appends a member."""
        self._zip.writestr(_plain(name), content)


class Reader:
    """An archive's file, opened, its form checked; :meth:`read` gives a member's content."""

    def __init__(self, file: Path) -> None:
        """Opens it.

        Raises:
            ArchiveError: the file is not of the form that :class:`Writer` writes, or cannot be read.
        """
        self._file = file
        try:
            self._stream = file.open("rb")
        except OSError as error:
            raise ArchiveError(file, f"it cannot be read ({error.strerror})") from error
        try:
            end = _directory(self._stream)
            self._zip = zipfile.ZipFile(self._stream)
            self._members = self._zip.infolist()
            _require_plain(self._members)
            self._require_whole(end)
        except _Wrong as error:
            self._stream.close()
            raise ArchiveError(file, str(error)) from None
        except _ZIP_ERRORS as error:
            self._stream.close()
            raise ArchiveError(file, f"it cannot be opened as a zip ({error})") from error
        self._by_name = {member.filename: member for member in self._members}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file."""
        self._zip.close()
        self._stream.close()

    @property
    def sizes(self) -> dict[str, int]:
        """The members' bytes by name, in their order."""
        return {member.filename: member.file_size for member in self._members}

    def read(self, name: str) -> bytes:
        """A member's content.

        Raises:
            ArchiveError: it is damaged.
        """
        try:
            return self._zip.read(self._by_name[name])
        except _ZIP_ERRORS as error:
            raise ArchiveError(self._file, f"{name} is damaged ({error})") from error

    def _require_whole(self, end: _Directory) -> None:
        """Refuses anything between the members, and headers and entries that the writer would not have written."""
        place = 0
        for member in self._members:
            header = _header(member)
            self._stream.seek(place)
            if member.header_offset != place or self._stream.read(len(header)) != header:
                raise _Wrong(
                    f"the header of its member {member.filename[:80]!a} is damaged, or not as this program writes it"
                )
            place += len(header) + member.file_size
        self._stream.seek(place)
        for member in self._members:
            entry = _entry(member)
            if self._stream.read(len(entry)) != entry:
                raise _Wrong(f"its member {member.filename[:80]!a} is not as this program writes it")
        if place != end.start or len(self._members) != end.members:
            raise _Wrong("its directory does not fit its members")


class _Directory(NamedTuple):
    """Of a zip file: where it begins, and how many members it lists."""

    start: int
    members: int


def _plain(name: str) -> zipfile.ZipInfo:
    """A member's fields as every archive has them."""
    member = zipfile.ZipInfo(name, _TIME)
    member.create_system = _UNIX
    member.external_attr = _RIGHTS
    return member


def _header(member: zipfile.ZipInfo) -> bytes:
    """What the writer puts before a member's content."""
    plain = _plain(member.filename)
    plain.CRC, plain.file_size, plain.compress_size = member.CRC, member.file_size, member.file_size
    return bytes(plain.FileHeader(zip64=False))


def _entry(member: zipfile.ZipInfo) -> bytes:
    """What the writer puts for a member into the directory."""
    place, more, version = member.header_offset, b"", zipfile.DEFAULT_VERSION
    if place > zipfile.ZIP64_LIMIT:
        place, more, version = 0xFFFFFFFF, _FAR.pack(1, 8, place), zipfile.ZIP64_VERSION
    name = member.filename.encode()
    made = version, _UNIX, version, 0, 0, zipfile.ZIP_STORED, 0, _DATE
    sizes = member.CRC, member.file_size, member.file_size, len(name), len(more)
    return _ENTRY.pack(b"PK\1\2", *made, *sizes, 0, 0, 0, _RIGHTS, place) + name + more


def _directory(stream: IO[bytes]) -> _Directory:
    """Reads the end of a zip file, before anything is made of its directory.

    Raises:
        _Wrong: the file has no such end, or claims more members than any archive.
    """
    stream.seek(0, 2)
    size = stream.tell()
    if size < _END.size:
        raise _Wrong("it is no zip file, or its end is missing")
    place = size - _END.size
    stream.seek(place)
    mark, disk, first_disk, here, count, length, start, comment = _END.unpack(stream.read(_END.size))
    if mark != b"PK\5\6" or (disk, first_disk, comment) != (0, 0, 0) or here != count:
        raise _Wrong("it is no zip file, or its end is missing or damaged")
    place, count, length, start = _large_directory(stream, place) or (place, count, length, start)
    if count > MOST_MEMBERS or length > count * _MOST_ENTRY_BYTES:
        raise _Wrong(f"it claims {count} members, and no archive has more than {MOST_MEMBERS}")
    if start + length != place:
        raise _Wrong("its directory is not where it should be")
    return _Directory(start, count)


def _large_directory(stream: IO[bytes], place: int) -> tuple[int, int, int, int] | None:
    """Where the directory of a file of more than 4 GB or 65,535 members ends, its count, length and start.

    None where the file has no end of that kind.
    """
    stream.seek(max(0, place - _LOCATOR.size))
    mark, _, end, disks = _LOCATOR.unpack(stream.read(_LOCATOR.size))
    if mark != b"PK\6\7":
        return None
    if disks != 1 or end != place - _LOCATOR.size - _LARGE_END.size:
        raise _Wrong("the end of its directory is damaged")
    stream.seek(end)
    found = _LARGE_END.unpack(stream.read(_LARGE_END.size))
    if found[0] != b"PK\6\6" or found[6] != found[7]:
        raise _Wrong("the end of its directory is damaged")
    return end, found[7], found[8], found[9]


def _require_plain(members: list[zipfile.ZipInfo]) -> None:
    """Refuses members that no archive has, each kind with its own sentence."""
    names: set[str] = set()
    for member in members:
        name = f"{member.filename[:80]!a}"
        if member.filename.startswith("/") or any(part in member.filename for part in ("..", "\\", ":")):
            raise _Wrong(f"{name} would lie outside of it")
        if member.compress_type != zipfile.ZIP_STORED or member.compress_size != member.file_size:
            raise _Wrong(f"{name} is compressed, and may hide any size")
        if member.flag_bits & _ENCRYPTED:
            raise _Wrong(f"{name} is encrypted")
        if stat.S_ISLNK(member.external_attr >> 16):
            raise _Wrong(f"{name} is a link")
        if member.file_size > (LARGEST_MANIFEST if member.filename == NAME else LARGEST_MEMBER):
            raise _Wrong(f"{name} of {member.file_size} bytes is too large")
        if member.filename in names:
            raise _Wrong("two of its members have one name")
        names.add(member.filename)
