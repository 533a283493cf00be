"""Synthetic shared maps: small images that change with the time of day, and a storage in a folder."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from common.environment.metadata import Archive, ImageAlong, MapMetadata, archive_key, metadata_key, report_key
from common.messages import MapReport, RepeatReport

ENVIRONMENT = "yard"
BEGIN = datetime(2026, 6, 1, tzinfo=UTC)
ARCHIVE = b"an archive"
SHAPE = (2, 3, 16)

_PATTERNS = np.random.default_rng(7).normal(size=(3, *SHAPE))


class FolderStorage:
    """Both buckets as folders, as the server sees them; it can be sent to another process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def read(self, key: str) -> bytes | None:
        path = self.folder / "environments" / key
        return path.read_bytes() if path.is_file() else None

    def write(self, key: str, content: bytes) -> None:
        self._write("environments", key, content)

    def remove(self, key: str) -> None:
        (self.folder / "environments" / key).unlink(missing_ok=True)

    def keys(self, prefix: str) -> Iterator[str]:
        root = self.folder / "environments"
        names = sorted(str(path.relative_to(root)) for path in root.rglob("*") if path.is_file())
        yield from (name for name in names if name.startswith(prefix))

    def archive_size(self, key: str) -> int | None:
        path = self.folder / "maps" / key
        return path.stat().st_size if path.is_file() else None

    def write_archive(self, key: str, content: bytes) -> None:
        self._write("maps", key, content)

    def _write(self, bucket: str, key: str, content: bytes) -> None:
        path = self.folder / bucket / key
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_bytes(content)
        part.replace(path)


def map_id(hours: float, robot: str = "r1") -> str:
    """The id of a map that was begun so many hours after the first."""
    return f"{BEGIN + timedelta(hours=hours):%Y%m%dT%H%M%S%f}-{robot}-{round(abs(hours) * 977) % 0xFFFFFF:06x}"


def image(hours: float, distance: float, seed: int = 0) -> ImageAlong:
    """What stands there looks otherwise by day and by night."""
    turn = 2.0 * np.pi * hours / 24.0
    noise = np.random.default_rng([seed, round(abs(hours) * 1000), round(distance)]).normal(size=SHAPE)
    values = _PATTERNS[0] + np.cos(turn) * _PATTERNS[1] + np.sin(turn) * _PATTERNS[2] + 0.1 * noise
    stored = np.rint(20.0 * values).clip(-127, 127).astype(np.int8)
    return ImageAlong.model_validate(
        {
            "distance": distance,
            "shape": SHAPE,
            "values": base64.b64encode(stored.tobytes()),
            "width": 160,
            "height": 30,
            "cell_height": 0.0625,
            "scale": 0.05,
            "name": "small",
        }
    )


def metadata(hours: float, start: str | None = "dock", end: str | None = "gate", **others) -> MapMetadata:
    """The metadata of a map of 20 m that was begun so many hours after the first."""
    robot = others.pop("robot", "r1")
    values = {
        "name": map_id(hours, robot),
        "environment": ENVIRONMENT,
        "robot": robot,
        "sensor": "stereo",
        "timestamp": BEGIN + timedelta(hours=hours),
        "length": 20.0,
        "start": start,
        "end": end,
        "vertices": 2,
        "times": [0.0, 20.0],
        "distances": [0.0, 20.0],
        "images": [image(hours, distance) for distance in (0.0, 10.0, 20.0)],
        "archive": Archive(bytes=len(ARCHIVE), sha256="0" * 64),
    }
    return MapMetadata.model_validate(values | others)


def share(storage, one: MapMetadata) -> str:
    """Commits a map as a robot does; its id."""
    storage.write_archive(archive_key(one.environment, one.name), ARCHIVE)
    storage.write(metadata_key(one.environment, one.name), one.model_dump_json().encode())
    return one.name


def report(storage, map_id: str, hour: float, lost: float, metres: float = 100.0, name: str = "a") -> str:
    """Commits the report of a repeat at an hour of the first day; its key."""
    told = RepeatReport(
        id=name,
        robot="r2",
        environment=ENVIRONMENT,
        stamp=int((BEGIN + timedelta(hours=hour)).timestamp() * 1e9),
        maps=[MapReport(map=map_id, metres=metres, lost=lost)],
    )
    key = report_key("r2", ENVIRONMENT, name)
    storage.write(key, told.model_dump_json().encode())
    return key


def garbage(storage) -> list[str]:
    """Commits objects that are none of what they should be; their keys."""
    good = json.loads(metadata(900.0).model_dump_json())
    contents = {
        metadata_key(ENVIRONMENT, map_id(901.0)): b"\x00 no JSON",
        metadata_key(ENVIRONMENT, map_id(902.0)): json.dumps(good).encode(),
        metadata_key(ENVIRONMENT, map_id(900.0)): json.dumps(good).encode(),
        report_key("r1", ENVIRONMENT, "torn"): b"{",
        report_key("r1", ENVIRONMENT, "../x"): b"{}",
        f"robots/r1/{ENVIRONMENT}/maps/../../escape.json": b"{}",
        "robots/r1/UPPER/maps/x.json": b"{}",
    }
    for key, content in contents.items():
        storage.write(key, content)
    return list(contents)
