"""What ``vtr align`` does with one pair of image files, and with a table of them."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from cli.errors import CommandError
from common.errors import RetraverseError
from common.registration import (
    GradientRepresentation,
    NetworkRepresentation,
    Prepared,
    Registrar,
    Registration,
    Representation,
)
from services.sensors.recordings.images import read_image

_KEPT = 256
"""Images whose representations are kept, of some 0.3 MB each: maps are compared with many images."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two images: their names as the user wrote them, their files, and the line that names them, 0 for none."""

    live: str
    stored: str
    live_file: Path
    stored_file: Path
    line: int = 0


@dataclass(frozen=True, slots=True)
class Aligned:
    """What came of a pair."""

    live: str
    stored: str
    registration: Registration


class Aligner:
    """Aligns pairs of files, and reads and describes each file once as long as it is in use."""

    def __init__(self, representation: Representation) -> None:
        registrar = Registrar(representation)

        @lru_cache(maxsize=_KEPT)
        def prepared(file: Path) -> Prepared:
            return registrar.prepare(read_image(file))

        self._registrar, self._prepared = registrar, prepared

    def align(self, pair: Pair) -> Aligned:
        """The shift of the scene from the stored to the live image.

        Raises:
            RetraverseError: an image cannot be read, or the two cannot be compared.
        """
        live, stored = self._prepared(pair.live_file), self._prepared(pair.stored_file)
        return Aligned(pair.live, pair.stored, self._registrar.register(live, stored))


def representation(model: Path | None, width: int | None) -> Representation:
    """The network that is named, else the classical representation.

    Raises:
        CommandError: a width was given and no network.
        ConfigurationError: the file holds no network.
    """
    if model is not None:
        return NetworkRepresentation(model, width)
    if width is not None:
        raise CommandError("--model-width is the width of the images that a network takes: name one with --model")
    return GradientRepresentation()


def requested(live: Path | None, stored: Path | None, pairs: Path | None, output: Path | None) -> Pair | Path:
    """The pair that was named, or the table of pairs.

    Raises:
        CommandError: neither was named, or both.
    """
    if pairs is not None:
        if live is not None:
            raise CommandError("give either two images or --pairs, not both")
        return pairs
    if live is None or stored is None:
        raise CommandError("give two images, LIVE and STORED, or a table of them with --pairs")
    if output is not None:
        raise CommandError("--output is for the table of --pairs; one pair's result is printed, with --json as JSON")
    return Pair(str(live), str(stored), live, stored)


def read_pairs(table: Path) -> list[Pair]:
    """The pairs of a table; a relative path counts from the table's folder, else from the current one.

    Raises:
        CommandError: it is no such table, or names an image that does not exist.
    """
    try:
        text = table.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise CommandError(f"cannot read {table}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise CommandError(f"{table} is no text: a table of pairs is a csv file with columns live and stored") from None
    reader = csv.DictReader(io.StringIO(text), skipinitialspace=True)
    try:
        missing = {"live", "stored"} - {(name or "").strip() for name in reader.fieldnames or ()}
        if missing:
            raise CommandError(f"{table} has no column {' and no column '.join(sorted(missing))} in its first line")
        reader.fieldnames = [name.strip() for name in reader.fieldnames or ()]
        pairs = [_pair(row, table, reader.line_num) for row in reader]
    except csv.Error as error:
        raise CommandError(f"{table}, line {reader.line_num}: {error}") from None
    if not pairs:
        raise CommandError(f"{table} names no pairs: each row below its first line is one")
    return pairs


def _pair(row: dict[str | Any, Any], table: Path, line: int) -> Pair:
    names = [(row[column] or "").strip() for column in ("live", "stored")]
    for column, name in zip(("live", "stored"), names, strict=True):
        if not name:
            raise CommandError(f"{table}, line {line}: no {column} image is named")
    live, stored = (_file(name, table, line) for name in names)
    return Pair(names[0], names[1], live, stored, line)


def _file(name: str, table: Path, line: int) -> Path:
    candidates = (table.parent / name, Path(name))
    found = next((path for path in candidates if path.is_file()), None)
    if found is None:
        raise CommandError(f"{table}, line {line}: there is no image {name} in {table.parent} or the current folder")
    return found


def align_all(aligner: Aligner, pairs: Sequence[Pair], table: Path, advance: Callable[[], None]) -> list[Aligned]:
    """What comes of each pair of a table; ``advance`` is called after each.

    Raises:
        CommandError: a pair cannot be aligned; the sentence names its line.
    """
    results = []
    for pair in pairs:
        try:
            results.append(aligner.align(pair))
        except RetraverseError as error:
            raise CommandError(f"{table}, line {pair.line}: {error}") from error
        advance()
    return results


def table_text(results: Sequence[Aligned]) -> str:
    """The results as csv: live, stored, shift in pixels, score."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["live", "stored", "shift_px", "score"])
    for result in results:
        found = result.registration
        writer.writerow([result.live, result.stored, f"{found.shift_px:.3f}", f"{found.score:.4f}"])
    return out.getvalue()
