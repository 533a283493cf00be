"""What robots have committed comes into an environment's state: checked, each once, whatever else is stored there."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import structlog
from pydantic import ValidationError

from common.environment.metadata import MapMetadata, archive_key, metadata_key, report_key, robot_of
from common.errors import RetraverseError
from common.messages import RepeatReport
from services.fleet.catalog import SharedMap
from services.fleet.feedback import Feedback
from services.fleet.groups import Along
from services.fleet.state import EnvironmentState
from services.fleet.store import CATALOG, FEEDBACK, Committed, Derived, Storage, images_name, together
from services.fleet.stored import (
    StaleObject,
    pack_catalog,
    pack_feedback,
    pack_images,
    unpack_catalog,
    unpack_feedback,
)

T = TypeVar("T")
Take = Callable[[str, bytes], None]

log = structlog.get_logger()

_BATCH = 64
_SAVED_AFTER = 0.02
"""Catalog and feedback are saved when this part of them is new: to read so much again takes no time."""


class BadObject(RetraverseError):
    """A committed object that is none of what it should be, and is left alone."""


class Intake:
    """Brings one environment's state up to what is committed."""

    def __init__(self, storage: Storage, state: EnvironmentState) -> None:
        self._storage, self._state = storage, state
        self._derived = Derived(storage, state.name)
        self._refused: dict[str, str] = {}
        self._unsaved_maps = self._unsaved_reports = 0

    def restore(self, listed: Committed) -> None:
        """Begins with what an earlier server has kept of what is still committed."""
        maps = self._kept(CATALOG, unpack_catalog) or []
        feedback = self._kept(FEEDBACK, unpack_feedback)
        stored = set(listed.reports)
        if feedback is None or not feedback.counted <= stored:
            feedback = Feedback()
        self._state.fill([one for one in maps if one.map in listed.maps], feedback)

    def reconcile(self, listed: Committed) -> None:
        """Takes what is committed and not known, and lets go of what is committed no longer."""
        gone = self._state.catalog.ids() - listed.maps.keys()
        if gone:
            log.info("maps are stored no longer", environment=self._state.name, maps=len(gone))
            self._state.remove(gone)
            self._unsaved_maps += len(gone)
        known = self._state.catalog.ids()
        self._take(self._take_map, [key for name, key in sorted(listed.maps.items()) if name not in known])
        counted = set(self._state.feedback.counted)
        self._take(self._take_report, [key for key in sorted(listed.reports) if key not in counted])
        self._save()

    def announced(self, robot: str, map_id: str | None, report: str | None) -> None:
        """Takes a map and a report that a robot says it has committed."""
        if map_id is not None and map_id not in self._state.catalog.ids():
            self._take(self._take_map, [metadata_key(self._state.name, map_id)])
        if report is not None:
            key = report_key(robot, self._state.name, report)
            if key not in self._state.feedback.counted:
                self._take(self._take_report, [key])
        self._save()

    def forget(self, listed: Committed) -> None:
        """Removes everything derived, and begins with what is committed; what was known serves until that is read."""
        self._derived.clear()
        self._refused.clear()
        anew = self._state.anew()
        Intake(self._storage, anew).reconcile(listed)
        self._state.fill(anew.catalog, anew.feedback)

    def _take(self, take: Take, keys: list[str]) -> None:
        for begin in range(0, len(keys), _BATCH):
            batch = keys[begin : begin + _BATCH]
            for key, content in zip(batch, together(self._storage, batch), strict=True):
                if content is not None:
                    self._try(take, key, content)

    def _try(self, take: Take, key: str, content: bytes) -> None:
        """Takes an object, or says once why it is left alone."""
        try:
            take(key, content)
        except BadObject as error:
            if self._refused.get(key) != str(error):
                log.warning("an object is left alone", key=key, reason=str(error))
            self._refused[key] = str(error)
        else:
            self._refused.pop(key, None)

    def _take_map(self, key: str, content: bytes) -> None:
        metadata = read_map(self._state.name, key, content)
        stored = self._storage.archive_size(archive_key(self._state.name, metadata.name))
        if stored != metadata.archive.bytes:
            size = "is not stored" if stored is None else f"has {stored} bytes"
            raise BadObject(f"its archive {size}, and should have {metadata.archive.bytes} bytes")
        images = self._images(key, metadata)
        if images is not None:
            self._derived.write(images_name(metadata.name), pack_images(images))
        self._state.add(SharedMap.of(metadata, 0 if images is None else len(images.values)))
        self._unsaved_maps += 1

    def _images(self, key: str, metadata: MapMetadata) -> Along | None:
        try:
            return Along.of(metadata) if metadata.start is not None and metadata.end is not None else None
        except ValueError as error:
            log.warning("a map cannot be compared", key=key, reason=str(error))
            return None

    def _take_report(self, key: str, content: bytes) -> None:
        self._state.report(key, read_report(self._state.name, key, content))
        self._unsaved_reports += 1

    def _kept(self, name: str, unpack: Callable[[bytes], T]) -> T | None:
        content = self._derived.read(name)
        try:
            return None if content is None else unpack(content)
        except StaleObject as error:
            log.warning("a derived object is made again", key=self._derived.key(name), reason=str(error))
            return None

    def _save(self) -> None:
        """Keeps catalog and feedback where enough of them is new."""
        state = self._state
        with state.lock:
            maps, reports = list(state.catalog), len(state.feedback.counted)
            feedback = pack_feedback(state.feedback) if self._unsaved_reports > _SAVED_AFTER * reports else None
        if self._unsaved_maps > _SAVED_AFTER * len(maps):
            self._derived.write(CATALOG, pack_catalog(maps))
            self._unsaved_maps = 0
        if feedback is not None:
            self._derived.write(FEEDBACK, feedback)
            self._unsaved_reports = 0


def read_map(environment: str, key: str, content: bytes) -> MapMetadata:
    """The metadata stored under a key.

    Raises:
        BadObject: they are none, or belong elsewhere.
    """
    try:
        metadata = MapMetadata.model_validate_json(content)
    except ValidationError as error:
        raise BadObject(f"it is no map's metadata: {_first(error)}") from None
    right = metadata_key(metadata.environment, metadata.name)
    if key != right or metadata.environment != environment or metadata.robot != robot_of(metadata.name):
        raise BadObject(f"it describes what belongs to {right}")
    return metadata


def read_report(environment: str, key: str, content: bytes) -> RepeatReport:
    """The report stored under a key.

    Raises:
        BadObject: it is none, or belongs elsewhere.
    """
    try:
        report = RepeatReport.model_validate_json(content)
    except ValidationError as error:
        raise BadObject(f"it is no report of a repeat: {_first(error)}") from None
    right = report_key(report.robot, report.environment, report.id)
    if key != right or report.environment != environment:
        raise BadObject(f"it tells of what belongs to {right}")
    return report


def images_of(storage: Storage, environment: str, map_id: str) -> Along | None:
    """The images in a map's metadata; None where they are not there, or hold nothing to compare."""
    key = metadata_key(environment, map_id)
    content = storage.read(key)
    try:
        return None if content is None else Along.of(read_map(environment, key, content))
    except (BadObject, ValueError):
        return None


def _first(error: ValidationError) -> str:
    first = error.errors(include_url=False, include_input=False)[0]
    where = ".".join(map(str, first["loc"]))
    return f"{where + ': ' if where else ''}{first['msg'].removeprefix('Value error, ')}"
