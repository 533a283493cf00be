"""Changes in TOML files that a person has written in: what is not changed, comments too, stays as it is."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from common.errors import ConfigurationError
from services.sensors.calibration.file import MountingTable, load

Check = Callable[[Path], object]
"""Raises where a file with the changes would not be a right one."""


def set_mounting(path: Path, mounting: MountingTable) -> None:
    """Puts a mounting into a calibration file.

    Raises:
        ConfigurationError: the file is no calibration, or cannot be written.
    """
    values: dict[str, Any] = {"position": [round(value, 6) for value in mounting.position]}
    values |= {name: round(getattr(mounting, name), 6) for name in ("roll", "pitch", "yaw")}
    change(path, ("calibration", "mounting"), values, load)


def change(path: Path, table: tuple[str, ...], values: Mapping[str, Any], check: Check) -> None:
    """Sets keys of a file's table, which is made where it is missing; the file is replaced as a whole.

    Raises:
        ConfigurationError: the file cannot be read, or not written, or ``check`` refuses what it would become.
    """
    check(path)
    try:
        document = tomlkit.parse(path.read_text(encoding="utf-8"))
        found: Any = document
        for name in table:
            found = found.setdefault(name, tomlkit.table())
        for key, value in values.items():
            if key in found and hasattr(found[key], "trivia"):
                made = tomlkit.item(value)
                made.trivia.comment_ws, made.trivia.comment = found[key].trivia.comment_ws, found[key].trivia.comment
                found[key] = made
            else:
                found[key] = value
        _replace(path, tomlkit.dumps(document), check)
    except TOMLKitError as error:
        raise ConfigurationError(f"{path} cannot be changed: {error}") from None
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error.strerror}") from None


def _replace(path: Path, text: str, check: Check) -> None:
    """Writes a file beside, has it checked, and puts it in the place of the old one."""
    target = path.resolve()
    handle, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".toml", dir=target.parent)
    beside = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        check(beside)
        beside.chmod(target.stat().st_mode & 0o777)
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)
