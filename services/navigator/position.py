"""Where the robot stands, kept in a small file, so that a navigator that is started anew still knows."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from common.errors import RetraverseError
from common.ids import VertexId


class PositionUnreadable(RetraverseError):
    """The file exists and holds no position."""


@dataclass(frozen=True, slots=True)
class Position:
    """A vertex of an environment."""

    environment: str
    vertex: VertexId


def load(path: Path) -> Position | None:
    """The position in a file, None where there is no file.

    Raises:
        PositionUnreadable: the file cannot be read, or holds something else.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return Position(str(content["environment"]), VertexId.parse(content["vertex"]))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise PositionUnreadable(
            f"the robot's last position cannot be read from {path}, so it is unknown: {error}"
        ) from None


def save(path: Path, position: Position | None) -> None:
    """Replaces the file in one step; without a position, removes it.

    It is not forced to the disk: that can take a second, and the position is worth less than an undisturbed state.

    Raises:
        OSError: the folder or the file cannot be written.
    """
    if position is None:
        path.unlink(missing_ok=True)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".new")
    draft.write_text(
        json.dumps({"environment": position.environment, "vertex": str(position.vertex)}), encoding="utf-8"
    )
    draft.replace(path)
