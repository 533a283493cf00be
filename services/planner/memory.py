"""What a robot has learnt of its fleet, kept in a file: with it, it plans when the network is gone."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from pathlib import Path

import structlog
from pydantic import BaseModel, ConfigDict, ValidationError

from common.messages import CatalogEntry, EnvironmentModel

_MOST_ENTRIES = 5000

log = structlog.get_logger()


class Learnt(BaseModel):
    """Of one environment: its newest model, and the shared maps that plans have named."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: EnvironmentModel | None = None
    entries: list[CatalogEntry] = []


class Memory:
    """A small file for each environment; what cannot be read or written is logged, and no plan waits for it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._known: dict[str, Learnt] = {}

    def recall(self, environment: str) -> Learnt:
        """What is known of an environment."""
        with self._lock:
            if environment not in self._known:
                self._known[environment] = self._read(environment)
            return self._known[environment]

    def learn(
        self, environment: str, model: EnvironmentModel | None = None, entries: Iterable[CatalogEntry] = ()
    ) -> None:
        """Takes a model, unless it is older than the one that is known, and maps; keeps what is new."""
        before = self.recall(environment)
        newer = model is not None and (before.model is None or model.stamp > before.model.stamp)
        by_name = {entry.map: entry for entry in before.entries} | {entry.map: entry for entry in entries}
        kept = sorted(by_name.values(), key=lambda entry: entry.map)[-_MOST_ENTRIES:]
        after = Learnt(model=model if newer else before.model, entries=kept)
        if after == before:
            return
        with self._lock:
            self._known[environment] = after
        self._write(environment, after)

    def _read(self, environment: str) -> Learnt:
        file = self._folder / f"{environment}.json"
        try:
            return Learnt.model_validate_json(file.read_bytes())
        except FileNotFoundError:
            return Learnt()
        except (OSError, ValidationError) as error:
            log.warning("what was learnt of the fleet cannot be read", file=str(file), reason=str(error).split("\n")[0])
            return Learnt()

    def _write(self, environment: str, learnt: Learnt) -> None:
        file = self._folder / f"{environment}.json"
        draft = file.with_suffix(".draft")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            draft.write_text(learnt.model_dump_json(), encoding="utf-8")
            draft.replace(file)
        except OSError as error:
            log.warning("what was learnt of the fleet cannot be kept", file=str(file), reason=error.strerror)
