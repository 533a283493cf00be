"""Writes a map to an archive, one vertex in memory at a time."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

from common import wire
from common.environment.metadata import Archive
from common.errors import GraphError
from common.ids import VertexId
from common.messages import MapSummary
from services.mapstore.archive.container import Writer
from services.mapstore.archive.manifest import (
    EDGES_A_MEMBER,
    LARGEST_MEMBER,
    NAME,
    Edges,
    Manifest,
    Member,
    edges_name,
    vertex_name,
)
from services.mapstore.store import Store

_WRITTEN = 4_000_000
_READ = 1 << 20


def write_archive(store: Store, map_id: str, file: Path) -> Archive:
    """Writes a finished map to ``file``, which is there whole or not at all; the same map gives the same bytes.

    Raises:
        GraphError: the map is unknown, not finished, or a keyframe of it is damaged.
        StoreError: the store cannot be read.
        OSError: the file cannot be written.
    """
    summary = store.summary(map_id)
    if not summary.finished or summary.vertices == 0:
        raise GraphError(f"map {map_id} is not finished, or has no vertices: only a whole map can be archived")
    draft = file.with_name(file.name + ".draft")
    draft.parent.mkdir(parents=True, exist_ok=True)
    try:
        with draft.open("wb") as stream:
            _fill(stream, _members(store, summary))
        made = checked_sum(draft)
        draft.replace(file)
        _keep_name(file.parent)
    finally:
        draft.unlink(missing_ok=True)
    return made


def checked_sum(file: Path) -> Archive:
    """The size and the SHA-256 sum of a file."""
    digest = hashlib.sha256()
    with file.open("rb") as raw:
        while part := raw.read(_READ):
            digest.update(part)
    return Archive(bytes=file.stat().st_size, sha256=digest.hexdigest())


def _fill(stream: IO[bytes], members: Iterable[tuple[str, bytes]]) -> None:
    """Writes an archive, on the disk when this returns, and little by little: a commit would have to wait for more."""
    waiting = 0
    with Writer(stream) as writer:
        for name, content in members:
            writer.add(name, content)
            waiting += len(content)
            if waiting >= _WRITTEN:
                stream.flush()
                os.fsync(stream.fileno())
                waiting = 0
    stream.flush()
    os.fsync(stream.fileno())


def _members(store: Store, summary: MapSummary) -> Iterator[tuple[str, bytes]]:
    """Names and contents of the members, the manifest last."""
    map_id, members, count = summary.record.id, list[Member](), 0
    for index in range(summary.vertices):
        content = bytes(wire.encode(store.whole_vertex(VertexId(map_id, index))))
        yield _listed(members, vertex_name(index), content)
    with contextlib.closing(store.edges_of(map_id)) as edges:
        while some := list(itertools.islice(edges, EDGES_A_MEMBER)):
            content = bytes(wire.encode(Edges(edges=some)))
            yield _listed(members, edges_name(count // EDGES_A_MEMBER), content)
            count += len(some)
    manifest = Manifest(
        map=summary.record,
        start_place=summary.start_place,
        end_place=summary.end_place,
        vertices=summary.vertices,
        edges=count,
        members=members,
    )
    yield NAME, manifest.model_dump_json().encode()


def _listed(members: list[Member], name: str, content: bytes) -> tuple[str, bytes]:
    """A member, and its line in the manifest."""
    if len(content) > LARGEST_MEMBER:
        raise GraphError(f"{name} of an archive takes {len(content)} bytes, and may take {LARGEST_MEMBER}")
    members.append(Member(name=name, bytes=len(content), sha256=hashlib.sha256(content).hexdigest()))
    return name, content


def _keep_name(folder: Path) -> None:
    """Waits until the disk knows the names in a folder."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
