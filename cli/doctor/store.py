"""What ``vtr doctor`` checks of a robot's folder and of the store in it."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from pathlib import Path

from cli.doctor.check import Check
from common.config import RobotConfig
from common.errors import RetraverseError
from services.mapstore.schema import GRAPH_TABLES, MIGRATIONS, version_of

LEAST_GB, WANTED_GB = 0.2, 2.0
_AWAY = "move it away, or restore a copy of it"
_ROOM = "make room: a taught kilometre takes some 0.2 GB"


def check_disk(directory: Path) -> Check:
    """Whether the robot's directory can be written to and has room."""
    place = next(folder for folder in (directory, *directory.parents) if folder.exists())
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        text = f"{place} cannot be written to: {error.strerror}"
        return Check("folder", "fail", text, "set 'directory' to a folder of yours, or chown it")
    free = shutil.disk_usage(place).free / 1e9
    text = f"{directory}: {free:.1f} GB free"
    if free < LEAST_GB:
        return Check("folder", "fail", text, _ROOM)
    return Check("folder", "warn", text, _ROOM) if free < WANTED_GB else Check("folder", "ok", text)


def check_store(configuration: RobotConfig) -> Check:
    """Whether the robot's map store is sound, and of a version that this program reads or can bring to its own."""
    file = configuration.directory.absolute() / "store" / "maps.sqlite"
    if not file.exists():
        return Check("store", "ok", "no map was taught yet")
    try:
        version, damage = _look(file)
    except RetraverseError as error:
        return Check("store", "fail", str(error), _AWAY)
    except sqlite3.Error as error:
        return Check("store", "fail", f"{file} cannot be read: {error}", _AWAY)
    return Check("store", "fail", f"{file} is damaged: {damage}", _AWAY) if damage else _of_version(file, version)


def _of_version(file: Path, version: int) -> Check:
    newest = len(MIGRATIONS)
    text = f"{file}, schema version {version}"
    if version > newest:
        return Check("store", "fail", f"{text}; this program knows {newest}", "update this program")
    if version < newest:
        advice = "the next start brings it there; copy it before, if you may go back to the older program"
        return Check("store", "warn", f"{text}, which becomes {newest}", advice)
    return Check("store", "ok", text)


def _look(file: Path) -> tuple[int, str]:
    """The schema's version, and what is damaged of the graph; nothing is written, nor is a running store held up."""
    db = sqlite3.connect(f"{file.as_uri()}?mode=ro", uri=True, timeout=1.0)
    try:
        there = {name for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        version = version_of(db)
        found = (db.execute(f"PRAGMA quick_check({table})").fetchone()[0] for table in GRAPH_TABLES if table in there)
        return version, next((text for text in found if text != "ok"), "")
    finally:
        db.close()
