"""Reads an archive that came from anywhere: only what its manifest promises, and only after all of it was verified."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from pydantic import ValidationError

from common import wire
from common.environment.metadata import Archive, robot_of
from common.errors import MalformedMessage
from common.ids import MAP_ID_PATTERN, VertexId
from common.messages import EdgeRecord, VertexRecord
from services.mapstore.archive.container import Reader
from services.mapstore.archive.errors import ArchiveError
from services.mapstore.archive.manifest import FORMAT, NAME, Edges, Manifest, Member, vertex_name
from services.mapstore.archive.writing import checked_sum

_MANIFEST_BYTES, _ENTRY_BYTES = 1000, 256
"""A manifest takes less, and less for each member."""

_PLACE_LENGTH = 100


class ArchiveReader:
    """An opened archive whose manifest fits its list of members; a context manager.

    Its members are read one at a time, each verified against the manifest's sum.
    """

    def __init__(self, file: Path) -> None:
        """Opens it.

        Raises:
            ArchiveError: it is no zip, or holds anything but a manifest and what that names, in its sizes.
        """
        self.file = file
        self._container = Reader(file)
        try:
            self.manifest = self._read_manifest()
            self._check_members()
        except BaseException:
            self._container.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._container.close()

    def vertices(self) -> Iterator[VertexRecord]:
        """The vertices in order.

        Raises:
            ArchiveError: one is damaged, or is another one than its name says.
        """
        for index in range(self.manifest.vertices):
            member = self.manifest.members[index]
            vertex = self._decode(VertexRecord, member)
            if vertex.id != VertexId(self.manifest.map.id, index):
                raise ArchiveError(self.file, f"{vertex_name(index)} holds vertex {str(vertex.id)!a}")
            yield vertex

    def edges(self) -> Iterator[list[EdgeRecord]]:
        """The edges in order, some at a time.

        Raises:
            ArchiveError: a member is damaged, or an edge does not belong to the map, or comes twice.
        """
        known: set[tuple[VertexId, VertexId]] = set()
        for member in self.manifest.members[self.manifest.vertices :]:
            some = self._decode(Edges, member).edges
            for edge in some:
                self._check_edge(edge)
                pair = min(edge.a, edge.b), max(edge.a, edge.b)
                if pair in known:
                    raise ArchiveError(self.file, f"it joins {edge.a} and {edge.b} twice")
                known.add(pair)
            yield some
        if len(known) != self.manifest.edges:
            raise ArchiveError(self.file, f"it has {len(known)} edges, and promises {self.manifest.edges}")

    def _read_manifest(self) -> Manifest:
        sizes = self._container.sizes
        if NAME not in sizes:
            raise ArchiveError(self.file, f"it has no {NAME}")
        if sizes[NAME] > _MANIFEST_BYTES + _ENTRY_BYTES * len(sizes):
            raise ArchiveError(self.file, f"its {NAME} of {sizes[NAME]} bytes is too large for its members")
        try:
            found = Manifest.model_validate_json(self._container.read(NAME))
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            place = ".".join(map(str, first["loc"]))[:_PLACE_LENGTH]
            if place == "format":
                raise ArchiveError(
                    self.file, f"its 'format' is not {FORMAT}, the only one known here; update the program"
                ) from None
            raise ArchiveError(self.file, f"its {NAME} is wrong at {place!a}: {first['msg']}") from None
        if robot_of(found.map.id) != found.map.robot:
            raise ArchiveError(self.file, f"it says that map {found.map.id} is of robot '{found.map.robot}'")
        return found

    def _check_members(self) -> None:
        sizes = self._container.sizes
        promised = {member.name: member.bytes for member in self.manifest.members} | {NAME: sizes[NAME]}
        for name, size in sizes.items():
            if name not in promised:
                raise ArchiveError(self.file, f"it holds {name[:80]!a}, which its {NAME} does not name")
            if size != promised[name]:
                raise ArchiveError(self.file, f"{name} has {size} bytes, not as many as promised")
        if missing := promised.keys() - sizes.keys():
            raise ArchiveError(self.file, f"{min(missing)} is missing")
        if list(sizes) != list(promised):
            raise ArchiveError(self.file, f"its members are not in the order of its {NAME}")

    def _check_edge(self, edge: EdgeRecord) -> None:
        own = self.manifest.map.id
        ends = [end for end in (edge.a, edge.b) if end.map_id == own]
        what = f"the edge from {str(edge.a)!a} to {str(edge.b)!a}"
        if not ends or any(end.index >= self.manifest.vertices for end in ends):
            raise ArchiveError(self.file, f"{what} is none of its map's")
        if any(re.match(MAP_ID_PATTERN, end.map_id) is None for end in (edge.a, edge.b)):
            raise ArchiveError(self.file, f"{what} joins what is no vertex")
        if edge.a == edge.b:
            raise ArchiveError(self.file, f"{what} joins a vertex to itself")
        if edge.kind == "temporal" and (len(ends) != 2 or abs(edge.a.index - edge.b.index) != 1):
            raise ArchiveError(self.file, f"{what} is temporal, and they do not follow each other")

    def _decode(self, model: type[wire.M], member: Member) -> wire.M:
        content = self._container.read(member.name)
        if hashlib.sha256(content).hexdigest() != member.sha256:
            raise ArchiveError(self.file, f"{member.name} does not have its sum")
        try:
            return wire.decode(model, content)
        except MalformedMessage as error:
            raise ArchiveError(self.file, f"{member.name} is {error}") from None


def verify(file: Path, expected: Archive | None = None, map_id: str | None = None) -> Manifest:
    """Reads all of an archive once, and takes nothing of it.

    Args:
        file: the archive.
        expected: the size and the sum that it must have, from the map's metadata.
        map_id: the map that it must be of.

    Raises:
        ArchiveError: anything about it is not as it must be.
    """
    if expected is not None:
        _check_expected(file, expected)
    with ArchiveReader(file) as archive:
        if map_id is not None and archive.manifest.map.id != map_id:
            raise ArchiveError(file, f"it is of map {archive.manifest.map.id}, not {map_id}")
        for _ in archive.vertices():
            pass
        for _ in archive.edges():
            pass
        return archive.manifest


def _check_expected(file: Path, expected: Archive) -> None:
    try:
        size = file.stat().st_size
        if size != expected.bytes:
            raise ArchiveError(file, f"it has {size} bytes, not the {expected.bytes} of its metadata")
        if checked_sum(file) != expected:
            raise ArchiveError(file, "it has another sum, not that of its metadata")
    except OSError as error:
        raise ArchiveError(file, f"it cannot be read ({error.strerror})") from error
