"""Images and folders of tiles that lie under the map, and how each environment's lies."""

from __future__ import annotations

import json
import math
import os
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import structlog

from services.console.errors import BadArguments, ConsoleError
from services.console.page import Resource

_KINDS = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".webp": "image/webp"}
_NAME = re.compile(r"^[\w][\w .-]{0,80}$")
_TILE = re.compile(r"^\d{1,2}/\d{1,8}/\d{1,8}\.(png|jpg|jpeg|webp)$")
_FIGURES = {"x": 1e6, "y": 1e6, "rotation": 10.0, "scale": 1e4, "opacity": 1.0}
"""What an alignment has, and the largest magnitude of each: metres, radians, metres a pixel, a share."""

log = structlog.get_logger()


class Backgrounds:
    """A folder of backgrounds, and the file that says how they lie; each call reads the folder anew."""

    def __init__(self, folder: Path, alignments: Path) -> None:
        self._folder = folder
        self._file = alignments
        self._alignments = self._load()

    def section(self, environment: str) -> dict[str, Any]:
        """What there is, and what an environment shows."""
        return {"available": self._available(), "shown": self._alignments.get(environment)}

    def align(self, environment: str, wanted: Mapping[str, Any] | None) -> str:
        """Lays a background under an environment's map, or none.

        ``wanted`` has its ``name``, ``x`` and ``y`` of its middle (m), ``rotation`` (rad), ``scale`` (m a pixel) and
        ``opacity``.

        Raises:
            BadArguments: there is no such background, or a figure is none.
        """
        if wanted is None:
            self._alignments.pop(environment, None)
        else:
            known = {one["name"] for one in self._available()}
            if wanted.get("name") not in known:
                raise BadArguments(f"there is no background '{wanted.get('name')}'")
            self._alignments[environment] = {"name": wanted["name"]} | {
                key: _figure(wanted, key, most) for key, most in _FIGURES.items()
            }
        self._save()
        return "no background is shown" if wanted is None else f"{wanted['name']} lies under the map"

    def resource(self, path: str) -> Resource | None:
        """An image, or a tile of a folder: ``name`` or ``name/z/x/y.png``."""
        name, _, tile = path.partition("/")
        if not _NAME.match(name) or (tile and not _TILE.match(tile)):
            return None
        file = self._folder / name / tile if tile else self._folder / name
        kind = _KINDS.get(file.suffix.lower())
        if kind is None or not file.is_file() or not file.resolve().is_relative_to(self._folder.resolve()):
            return None
        return Resource(file.read_bytes(), kind)

    def store(self, name: str, body: bytes) -> str:
        """Keeps an uploaded image.

        Raises:
            BadArguments: it is no image, or its name is none.
            ConsoleError: it cannot be written.
        """
        if not _NAME.match(name) or Path(name).suffix.lower() not in _KINDS:
            raise BadArguments("a background is a .png, .jpg or .webp file with a plain name")
        if not body or cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_REDUCED_GRAYSCALE_8) is None:
            raise BadArguments(f"{name} is no image that can be read")
        _write(self._folder / name, body)
        return f"{name} is there"

    def _available(self) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = []
        try:
            entries = sorted(self._folder.iterdir())
        except OSError:
            return found
        for entry in entries:
            if not _NAME.match(entry.name):
                continue
            if entry.is_file() and entry.suffix.lower() in _KINDS:
                found.append({"name": entry.name, "kind": "image"})
            elif entry.is_dir() and (tiles := _tiles(entry)) is not None:
                found.append({"name": entry.name, "kind": "tiles", **tiles})
        return found

    def _load(self) -> dict[str, dict[str, Any]]:
        try:
            stored = json.loads(self._file.read_text(encoding="utf-8"))
            return {
                str(environment): {"name": str(one["name"])}
                | {k: _figure(one, k, most) for k, most in _FIGURES.items()}
                for environment, one in stored.items()
            }
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, AttributeError, KeyError, TypeError, BadArguments) as error:
            log.warning("how backgrounds lie cannot be read, and is forgotten", file=str(self._file), reason=str(error))
            return {}

    def _save(self) -> None:
        _write(self._file, json.dumps(self._alignments, indent=1).encode())


def _tiles(folder: Path) -> dict[str, Any] | None:
    """The zooms of a folder of tiles ``z/x/y``, and the range of x and y at the closest one."""
    zooms = sorted(int(entry.name) for entry in folder.iterdir() if entry.name.isdigit() and entry.is_dir())
    if not zooms:
        return None
    columns = [entry for entry in (folder / str(zooms[-1])).iterdir() if entry.name.isdigit()]
    tiles = [file for column in columns for file in column.iterdir() if file.stem.isdigit() and file.suffix in _KINDS]
    if not tiles:
        return None
    xs, ys = [int(column.name) for column in columns], [int(file.stem) for file in tiles]
    return {"zooms": [zooms[0], zooms[-1]], "x": [min(xs), max(xs)], "y": [min(ys), max(ys)], "suffix": tiles[0].suffix}


def _figure(wanted: Mapping[str, Any], key: str, most: float) -> float:
    value = wanted.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or abs(value) > most:
        raise BadArguments(f"'{key}' of a background is a number of at most {most:g}")
    return float(value)


def _write(file: Path, content: bytes) -> None:
    """All of it or nothing."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=file.parent, prefix=".")
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        Path(name).replace(file)
    except OSError as error:
        raise ConsoleError(f"cannot write {file}: {error.strerror}") from None
