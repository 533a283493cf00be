"""The files that the sub-commands of ``vtr env`` read: series, similarities, and folders of maps' images."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cli.errors import CommandError
from common.environment.costs import MODES, Theta
from common.environment.model import parse_time, read_json
from common.environment.table import hours_of
from common.registration import Prepared
from services.fleet.similarity import Comparer, SimilarityMatrix, even_shares
from services.sensors.recordings.images import image_files, read_image

Array = NDArray[np.float64]

_STAMP = re.compile(r"(\d{4}-\d{2}-\d{2})[T_ ](\d{2})[-_:](\d{2})(?:[-_:](\d{2}))?")
_SECONDS = 3600.0


@dataclass(frozen=True, slots=True)
class StoredMap:
    """A map by its images: its name, when it was recorded, hours since the Unix epoch, and the files in order."""

    name: str
    hours: float
    images: list[Path]


def at(text: str | None) -> float:
    """The hours since the Unix epoch of a time given with ``--at``; now, without one.

    Raises:
        CommandError: it is no time.
    """
    if text is None:
        return hours_of(datetime.now(UTC))
    try:
        return hours_of(parse_time(text))
    except (ValueError, OverflowError) as error:
        raise CommandError(f"--at: {error}") from None


def weights(theta: tuple[float, float, float] | None, mode: str | None) -> Theta:
    """The weights of ``--theta`` or of ``--mode``; those of robust navigation where neither is given.

    Raises:
        CommandError: both were given, there is no such mode, or a weight is no finite number.
    """
    if theta is not None and mode is not None:
        raise CommandError("give either --theta or --mode, not both")
    if theta is None:
        if mode is not None and mode not in MODES:
            raise CommandError(f"--mode: there is no '{mode}': choose of {', '.join(MODES)}")
        return MODES[mode or "robust"]
    try:
        return Theta(*theta)
    except ValueError as error:
        raise CommandError(f"--theta: {error}") from None


def read_series(path: Path) -> tuple[Array, Array]:
    """Hours (N,) and values (N,) of a csv file of unix seconds and values, with a first line of names or without.

    Raises:
        CommandError: it is no such file; the sentence names the line.
    """
    try:
        rows = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8-sig"))))
    except OSError as error:
        raise CommandError(f"cannot read {path}: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise CommandError(f"{path} is no csv file: each line is unix seconds, value") from None
    seconds, values = [], []
    for number, row in enumerate(rows, start=1):
        if not any(cell.strip() for cell in row):
            continue
        try:
            pair = [float(cell) for cell in row[:2]]
        except ValueError:
            if number == 1:
                continue
            raise CommandError(f"{path}, line {number}: '{','.join(row)}' is not unix seconds, value") from None
        if len(row) < 2 or not np.isfinite(pair).all():
            raise CommandError(f"{path}, line {number}: '{','.join(row)}' is not unix seconds, value")
        seconds.append(pair[0])
        values.append(pair[1])
    return np.array(seconds) / _SECONDS, np.array(values)


def read_similarity(path: Path) -> SimilarityMatrix:
    """The similarities in a JSON file: ``timestamps``, unix seconds or ISO 8601, ``matrix``, and ``names`` if any.

    Raises:
        CommandError: it holds no such thing.
    """
    content = read_json(path)
    if not isinstance(content, dict) or not {"timestamps", "matrix"} <= content.keys():
        raise CommandError(f"{path} must be a JSON object with timestamps and matrix")
    stamps, matrix = content["timestamps"], content["matrix"]
    if not isinstance(stamps, list):
        raise CommandError(f"{path}: timestamps must be a list")
    try:
        values = (
            np.array(matrix, dtype=np.float64).reshape(0, 0) if matrix == [] else np.array(matrix, dtype=np.float64)
        )
    except (TypeError, ValueError):
        raise CommandError(f"{path}: matrix must be a square of numbers, a row for each timestamp") from None
    if values.shape != (len(stamps), len(stamps)):
        shape = "x".join(map(str, values.shape))
        raise CommandError(
            f"{path}: matrix is {shape}, and there are {len(stamps)} timestamps: it must be a square of them"
        )
    if not np.isfinite(values).all():
        raise CommandError(f"{path}: matrix holds a value that is not finite")
    names = content.get("names", [str(k) for k in range(len(stamps))])
    if not isinstance(names, list) or len(names) != len(stamps):
        raise CommandError(f"{path}: names must be a list with one for each timestamp")
    return SimilarityMatrix(tuple(map(str, names)), np.array([_hours(stamp, path) for stamp in stamps]), values)


def similarity_text(matrix: SimilarityMatrix) -> str:
    """The file that :func:`read_similarity` reads."""
    return json.dumps(similarity_json(matrix), allow_nan=False) + "\n"


def similarity_json(matrix: SimilarityMatrix) -> dict[str, Any]:
    """The content of that file."""
    return {
        "names": list(matrix.names),
        "timestamps": [round(hours * _SECONDS, 3) for hours in matrix.hours.tolist()],
        "matrix": [[round(value, 6) for value in row] for row in matrix.values.tolist()],
    }


def find_maps(folder: Path) -> list[StoredMap]:
    """The maps of a folder, by time: each sub-folder with images is one, or else each image; named by their times.

    Raises:
        CommandError: there is no such folder, it holds no images, or a name tells no time.
    """
    if not folder.is_dir():
        raise CommandError(f"there is no folder {folder}")
    folders = sorted(path for path in folder.iterdir() if path.is_dir())
    found = [(path, image_files(path)) for path in folders] or [(file, [file]) for file in image_files(folder)]
    made = [StoredMap(path.stem if path.is_file() else path.name, _named_hours(path), files) for path, files in found]
    return sorted(made, key=lambda one: one.hours)


def compare(
    maps: Sequence[StoredMap], known: SimilarityMatrix, along: int, advance: Callable[[], None]
) -> SimilarityMatrix:
    """The matrix with a row for each map that it does not know; ``advance`` is called after each map.

    Raises:
        CommandError: the matrix knows a map that is not there.
        RetraverseError: an image cannot be read or compared.
    """
    comparer = Comparer()
    by_name = {one.name: one for one in maps}
    missing = [name for name in known.names if name not in by_name]
    if missing:
        raise CommandError(f"the images of map '{missing[0]}' are not there, so nothing can be compared with it")
    new = [one for one in maps if one.name not in set(known.names)]
    prepared: list[list[Prepared]] = []
    for one in [*(by_name[name] for name in known.names), *new]:
        images = comparer.prepare([read_image(one.images[k]) for k in even_shares(len(one.images), along)])
        if len(prepared) >= len(known.names):
            known = known.with_row(one.name, one.hours, comparer.row(images, prepared))
        prepared.append(images)
        advance()
    return known


def _hours(stamp: object, path: Path) -> float:
    if isinstance(stamp, int | float) and not isinstance(stamp, bool) and np.isfinite(stamp):
        return stamp / _SECONDS
    try:
        return hours_of(parse_time(str(stamp)))
    except ValueError as error:
        raise CommandError(f"{path}: timestamps: {error}") from None


def _named_hours(path: Path) -> float:
    found = _STAMP.search(path.name)
    text = f"{found[1]}T{found[2]}:{found[3]}:{found[4] or '00'}" if found else ""
    try:
        return hours_of(parse_time(text))
    except ValueError:
        raise CommandError(f"{path} has no time in its name: name it as 2023-06-13T03_11_46") from None
