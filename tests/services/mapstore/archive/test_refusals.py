"""What is no sound archive of the map that it should be is refused with one sentence, and nothing is stored."""

from __future__ import annotations

import hashlib
import io
import json
import os
import pickle
import stat
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common import wire
from common.environment.metadata import Archive
from common.ids import VertexId
from common.messages import Commit, GraphQuery, VertexRecord
from services.mapstore.archive import ArchiveError, container, import_archive, write_archive
from services.mapstore.archive.manifest import Edges, Manifest, Member
from services.mapstore.store import Store
from tests.services.mapstore.archive.conftest import REPEATED, SETTINGS, TAUGHT, Archived
from tests.services.mapstore.graphs import map_id, record, spatial, temporal, vertex, vertex_id

Members = dict[str, bytes]
EDGES, MANIFEST = "edges/000000.bin", "manifest.json"
FIRST, SECOND, THIRD, FOURTH, SEVENTH = (f"vertices/00000{k}.bin" for k in (0, 1, 2, 3, 6))


def members_of(file: Path) -> Members:
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def written(members: Members, file: Path, **changes: Any) -> Path:
    """An archive whose sums are right, whatever it holds; ``changes`` go into its manifest."""
    manifest = json.loads(members[MANIFEST])
    manifest["members"] = [
        {"name": name, "bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        for name, content in _ordered(members)
        if name != MANIFEST
    ]
    members = members | {MANIFEST: json.dumps(manifest | changes).encode()}
    with file.open("wb") as stream, container.Writer(stream) as writer:
        for name, content in [*_ordered(members), (MANIFEST, members[MANIFEST])]:
            writer.add(name, content)
    return file


def _ordered(members: Members) -> list[tuple[str, bytes]]:
    """Vertices, then edges, then whatever else is there, without the manifest."""
    rest = sorted((name for name in members if name != MANIFEST), key=lambda name: (name[0] != "v", name))
    return [(name, members[name]) for name in rest]


def nothing_in(store: Store) -> bool:
    return store.maps(GraphQuery()).maps == [] and store.counts()[2] == 0 and store.removable() == []


def refused(store: Store, file: Path, sentence: str, expected: Archive | None = None) -> None:
    with pytest.raises(ArchiveError, match=sentence) as found:
        import_archive(store, file, expected)
    assert "\n" not in str(found.value)
    assert file.name in str(found.value)
    assert nothing_in(store)


def plain(name: str) -> zipfile.ZipInfo:
    member = zipfile.ZipInfo(name)
    member.create_system = 3
    member.external_attr = 0o100644 << 16
    return member


def linked() -> zipfile.ZipInfo:
    member = plain(FIRST)
    member.external_attr = (stat.S_IFLNK | 0o777) << 16
    return member


EMPTY = Manifest.model_construct(
    map=record(0), vertices=1, edges=0, members=[Member(name=FIRST, bytes=1, sha256="0" * 64)]
).model_dump_json().encode()  # fmt: skip
STRAY = {"a": b"1", MANIFEST: EMPTY}
NEWER = EMPTY.replace(b'"format":1', b'"format":2')

HOSTILE: dict[str, Callable[[zipfile.ZipFile], object]] = {
    "would lie outside": lambda z: z.writestr(plain("../../etc/passwd"), b"x"),
    "'/etc/passwd' would lie outside": lambda z: z.writestr(plain("/etc/passwd"), b"x"),
    "would lie outside of it": lambda z: z.writestr(plain("a\\..\\b"), b"x"),
    "'C:/x' would lie outside": lambda z: z.writestr(plain("C:/x"), b"x"),
    "is compressed, and may hide any size": lambda z: z.writestr(plain("a"), bytes(10**7), zipfile.ZIP_DEFLATED),
    "is a link": lambda z: z.writestr(linked(), b"/etc/passwd"),
    "which its manifest.json does not name": lambda z: (
        z.writestr(plain("a"), b"1"),
        z.writestr(plain(MANIFEST), EMPTY),
    ),
    "two of its members have one name": lambda z: (z.writestr(plain("a"), b"1"), z.writestr(plain("a"), b"2")),
    "it has no manifest.json": lambda z: z.writestr(plain("code.py"), b"import os"),
    "not as this program writes it": lambda z: z.writestr(zipfile.ZipInfo("a", (2026, 1, 1, 0, 0, 0)), b"x"),
    "its manifest.json is wrong at '': Invalid JSON": lambda z: z.writestr(plain(MANIFEST), b"\x80\x04."),
    "its manifest.json is wrong at": lambda z: z.writestr(plain(MANIFEST), b"[1, 2]"),
    "its manifest.json of 50000 bytes is too large": lambda z: z.writestr(plain(MANIFEST), b" " * 50_000),
    "its 'format' is not 1, the only one known here; update": lambda z: z.writestr(plain(MANIFEST), NEWER),
}


@pytest.mark.parametrize("sentence", HOSTILE)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_zip_of_another_kind_is_refused(store: Store, tmp_path: Path, sentence: str) -> None:
    file = tmp_path / "hostile.zip"
    with zipfile.ZipFile(file, "w") as archive:
        HOSTILE[sentence](archive)
    before = sorted(tmp_path.rglob("*"))
    refused(store, file, sentence)
    assert sorted(tmp_path.rglob("*")) == before


def test_an_encrypted_member_is_refused(store: Store, tmp_path: Path) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(plain("a"), b"secret")
    content = bytearray(stream.getvalue())
    content[6] |= 1
    content[content.index(b"PK\1\2") + 8] |= 1
    file = tmp_path / "a.zip"
    file.write_bytes(content)
    refused(store, file, "is encrypted")


class Trap:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("trapped",)


@pytest.mark.parametrize(
    "content",
    [b"", b"PK", b"no zip at all" * 100, pickle.dumps(Trap()), bytes(100_000)],
    ids=["empty", "short", "text", "pickle", "zeros"],
)
def test_a_file_that_is_no_zip_is_refused(
    store: Store, tmp_path: Path, content: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "a.zip"
    file.write_bytes(content)
    refused(store, file, "it is no zip file")
    assert not (tmp_path / "trapped").exists()
    refused(store, tmp_path / "missing.zip", "cannot be read .No such file")


def test_a_pickle_in_place_of_a_vertex_is_refused_and_never_run(
    driven: Store, other: Store, taught: Archived, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del driven
    monkeypatch.chdir(tmp_path)
    members = members_of(taught.file) | {FIRST: pickle.dumps(Trap())}
    refused(other, written(members, tmp_path / "a.zip"), "000000.bin is the bytes do not begin")
    assert not (tmp_path / "trapped").exists()


@pytest.mark.parametrize("claimed", [2**16 - 2, 2**31])
def test_a_directory_of_untold_members_is_not_read(store: Store, tmp_path: Path, claimed: int) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(plain("a"), b"x")
    content = stream.getvalue()
    end = bytearray(content[-22:])
    place = len(content) - 22
    if claimed < 2**16:
        end[8:12] = claimed.to_bytes(2, "little") * 2
        content = content[:-22] + bytes(end)
    else:
        large = struct.pack("<4sQ2H2L4Q", b"PK\6\6", 44, 45, 45, 0, 0, claimed, claimed, claimed * 46, 0)
        content = content[:-22] + large + struct.pack("<4sLQL", b"PK\6\7", 0, place, 1) + bytes(end)
    file = tmp_path / "a.zip"
    file.write_bytes(content)
    refused(store, file, r"is not where it should be|claims 2147483648 members|does not fit its members")


def test_a_member_that_claims_to_be_huge_is_refused(store: Store, tmp_path: Path) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(plain("a"), b"x" * 100)
    content = bytearray(stream.getvalue())
    place = content.index(b"PK\1\2")
    for field in (20, 24):
        content[place + field : place + field + 4] = (2**32 - 2).to_bytes(4, "little")
    file = tmp_path / "a.zip"
    file.write_bytes(content)
    refused(store, file, "is too large")


def test_nothing_may_stand_before_between_or_behind_the_members(
    driven: Store, other: Store, taught: Archived, tmp_path: Path
) -> None:
    del driven
    content = taught.file.read_bytes()
    file = tmp_path / "a.zip"
    for changed in (b"#!/bin/sh\n" + content, content + b"x", content[:-22] + b"x" + content[-22:]):
        file.write_bytes(changed)
        with pytest.raises(ArchiveError):
            import_archive(other, file, None)
        assert nothing_in(other)


def test_a_flipped_bit_anywhere_is_refused(driven: Store, other: Store, taught: Archived, tmp_path: Path) -> None:
    del driven
    content = taught.file.read_bytes()
    file = tmp_path / "a.zip"
    rng = np.random.default_rng(0)
    for place in {*range(200), *range(len(content) - 1500, len(content)), *rng.integers(0, len(content), 500).tolist()}:
        changed = bytearray(content)
        changed[place] ^= 1 << int(rng.integers(8))
        file.write_bytes(changed)
        with pytest.raises(ArchiveError) as found:
            import_archive(other, file, None)
        assert "\n" not in str(found.value)
    assert nothing_in(other)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cuts=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 40), st.binary(max_size=40)), min_size=1, max_size=4))
def test_bytes_changed_cut_or_added_are_refused_or_change_nothing(
    driven: Store, other: Store, taught: Archived, tmp_path: Path, cuts: list[tuple[float, int, bytes]]
) -> None:
    del driven
    content = taught.file.read_bytes()
    changed = content
    for share, length, new in cuts:
        place = round(share * len(changed))
        changed = changed[:place] + new + changed[place + length :]
    file = tmp_path / "a.zip"
    file.write_bytes(changed)
    if changed != content:
        with pytest.raises(ArchiveError):
            import_archive(other, file, None)
        assert nothing_in(other)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_truncated_file_is_refused(
    driven: Store, other: Store, taught: Archived, tmp_path: Path, share: float
) -> None:
    del driven
    file = tmp_path / "a.zip"
    content = taught.file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    refused(other, file, "its end is missing")
    refused(other, file, "of its metadata", taught.archive)


def test_another_sum_or_map_than_expected_is_refused(
    driven: Store, other: Store, taught: Archived, repeated: Archived
) -> None:
    del driven
    same_size = Archive(bytes=taught.archive.bytes, sha256=repeated.archive.sha256)
    refused(other, taught.file, "it has another sum", same_size)
    with pytest.raises(ArchiveError, match=f"it is of map {map_id(TAUGHT)}, not {map_id(REPEATED)}"):
        import_archive(other, taught.file, taught.archive, map_id(REPEATED))
    assert nothing_in(other)


def encoded(*edges: Any) -> bytes:
    return bytes(wire.encode(Edges(edges=list(edges))))


def foreign(name: str, index: int) -> bytes:
    return bytes(wire.encode(Edges(edges=[spatial(VertexId(name, index), vertex_id(TAUGHT, 0))])))


WRONG: dict[str, Callable[[Members], Members]] = {
    f"000.bin holds vertex '{map_id(5)}:0'": lambda m: m | {FIRST: bytes(wire.encode(vertex(5, 0)))},
    f"001.bin holds vertex '{map_id(0)}:2'": lambda m: m | {SECOND: m[THIRD], THIRD: m[SECOND]},
    "000000.bin is not a VertexRecord": lambda m: m | {FIRST: m[EDGES]},
    "000000.bin is the bytes do not begin": lambda m: m | {FIRST: b"\x00" * 100},
    "is not a Edges": lambda m: m | {EDGES: m[FIRST]},
    "is not a Edges: 'map'": lambda m: m | {EDGES: bytes(wire.encode(Commit(map=record(3))))},
    "is none of its map's": lambda m: m | {EDGES: encoded(temporal(1, 1))},
    "twice": lambda m: m | {EDGES: encoded(temporal(0, 1), temporal(0, 1))},
    "is none of its map": lambda m: m | {EDGES: encoded(temporal(0, 9))},
    "a vertex to itself": lambda m: m | {EDGES: encoded(spatial(vertex_id(0, 1), vertex_id(0, 1)))},
    "do not follow each other": lambda m: (
        m | {EDGES: encoded(spatial(vertex_id(0, 1), vertex_id(0, 3)).model_copy(update={"kind": "temporal"}))}
    ),
    "joins what is no vertex": lambda m: m | {EDGES: foreign("../../etc", 0)},
    "has 1 edges, and promises 9": lambda m: m | {EDGES: encoded(temporal(0, 1))},
    "its members are not one for each vertex and then those of its edges": lambda m: m | {SEVENTH: m[FIRST]},
    "members are not one for each vertex and then": lambda m: {k: v for k, v in m.items() if k != FIRST},
    "manifest.json is wrong at 'members": lambda m: m | {"graph/code.py": b"import os"},
}


@pytest.mark.parametrize("sentence", WRONG)
def test_sound_sums_over_wrong_content_help_nothing(
    driven: Store, other: Store, taught: Archived, tmp_path: Path, sentence: str
) -> None:
    del driven
    refused(other, written(WRONG[sentence](members_of(taught.file)), tmp_path / "a.zip"), sentence)


def test_a_manifest_that_contradicts_itself_is_refused(
    driven: Store, other: Store, taught: Archived, tmp_path: Path
) -> None:
    del driven
    members = members_of(taught.file)
    file = tmp_path / "a.zip"
    strange = record(TAUGHT).model_copy(update={"robot": "r9"}).model_dump(mode="json")
    refused(other, written(members, file, map=strange), "of robot 'r9'")
    refused(other, written(members, file, map=record(5).model_dump(mode="json")), "holds vertex")
    refused(other, written(members, file, vertices=0), "wrong at 'vertices'")
    refused(other, written(members, file, vertices=10**9), "not one for each vertex")
    refused(other, written(members, file, start_place="../barn"), "wrong at 'start_place'")
    refused(other, written(members, file, surprise=1), "wrong at 'surprise'")
    refused(other, written(members, file, format="1"), "its 'format' is not 1")


def test_a_vertex_that_is_changed_while_it_is_read_is_not_stored(
    driven: Store, other: Store, taught: Archived, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Checked and then changed on the disk: what is stored was checked when it was read to be stored."""
    del driven
    place = taught.file.read_bytes().index(members_of(taught.file)[FOURTH]) + 700

    def spoil(*_: object) -> None:
        with taught.file.open("r+b") as stream:
            stream.seek(place)
            stream.write(b"\xff\x00\xff\x00")

    monkeypatch.setattr("services.mapstore.archive.importing._AT_A_TIME", 1)
    with pytest.raises(ArchiveError, match="is damaged"):
        import_archive(other, taught.file, None, advance=spoil)
    assert other.maps(GraphQuery()).maps == []


def test_keyframes_of_every_kind_of_array_arrive(store: Store, other: Store, tmp_path: Path) -> None:
    """An archive holds wire messages: what a commit may hold, an archive may."""
    arrays: dict[str, Any] = {
        dtype: np.arange(6).reshape(2, 3).astype(dtype) for dtype in ("bool", "u1", "<u8", "i1", "<i8", "<f4", "<f8")
    }
    looks = {"plain": np.ones((3, 32), np.uint8), "invariant": np.zeros((0, 32), np.uint8)}
    kept = vertex(0, 0).keyframe.model_copy(update={"arrays": arrays, "appearance": looks})
    whole = VertexRecord(id=vertex_id(0, 0), stamp=0, keyframe=kept)
    store.commit(Commit(map=record(0), vertex=whole, finished=map_id(0)))
    archive = write_archive(store, map_id(0), tmp_path / "a.zip")
    import_archive(other, tmp_path / "a.zip", archive)
    found = other.whole_vertex(vertex_id(0, 0))
    assert wire.encode(found) == wire.encode(whole.model_copy(update={"keyframe": kept.model_copy(
        update={"appearance": dict(sorted(looks.items()))})}))  # fmt: skip


def test_a_reader_keeps_no_file_open(other: Store, tmp_path: Path) -> None:
    assert SETTINGS.reserve_mb == 0
    (tmp_path / "a.zip").write_bytes(b"x" * 100)
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(5):
        with pytest.raises(ArchiveError):
            import_archive(other, tmp_path / "a.zip", None)
    assert len(list(Path("/proc/self/fd").iterdir())) == before
