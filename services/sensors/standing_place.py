"""Where the simulated robot stands, kept in a file: a robot does not jump home when its driver process is killed."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from services.sensors.world.base import BaseState

_FIELDS = tuple(field.name for field in fields(BaseState))


class StandingPlace:
    """The base's state in a memory-mapped file, which outlives the process that writes it."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        size = (len(_FIELDS) + 1) * 8
        if not path.exists() or path.stat().st_size != size:
            path.write_bytes(bytes(size))
        self._values = np.memmap(path, dtype=np.float64, mode="r+")

    def load(self) -> BaseState | None:
        """The state that was saved last, None where there is none."""
        *values, valid = self._values.tolist()
        if valid != 1.0:
            return None
        try:
            return BaseState.from_dict(dict(zip(_FIELDS, values, strict=True)))
        except ValueError:
            return None

    def save(self, state: BaseState) -> None:
        """Keeps a state; costs no system call."""
        self._values[:-1] = [getattr(state, name) for name in _FIELDS]
        self._values[-1] = 1.0
