"""How alike an environment's maps are, a row for each new one, and the model that follows from it."""

from __future__ import annotations

import numpy as np
import structlog
from numpy.typing import NDArray

from common.messages import EnvironmentModel, EnvironmentSpectrum, now_ns
from services.fleet.blocks import Block, held, part_of_row
from services.fleet.cluster import Cluster
from services.fleet.groups import Along, Bank, Group, Key, Kind
from services.fleet.intake import images_of
from services.fleet.rows import Images, row
from services.fleet.settings import Settings
from services.fleet.spectrum import Settings as SpectrumSettings
from services.fleet.spectrum import Spectrum, of_maps
from services.fleet.state import EnvironmentState
from services.fleet.store import MODEL, SPECTRUM, Derived, Storage, images_name, row_name
from services.fleet.stored import (
    Row,
    StaleObject,
    pack_images,
    pack_model,
    pack_row,
    pack_spectrum,
    unpack_images,
    unpack_model,
    unpack_row,
    unpack_spectrum,
)

Array = NDArray[np.float64]

BLOCK = 128
"""Maps that one task compares with."""
_TEXT = 2000

log = structlog.get_logger()


class Analysis:
    """Rows and model of one environment; used by one thread."""

    def __init__(self, storage: Storage, cluster: Cluster, state: EnvironmentState, settings: Settings) -> None:
        self._storage = storage
        self._derived = Derived(storage, state.name)
        self._cluster, self._state = cluster, state
        self._spectrum = SpectrumSettings(level=settings.level, shortest_hours=settings.shortest_hours)
        self._banks: dict[Key, tuple[Group, Bank, dict[int, str]]] = {}

    def restore_model(self) -> EnvironmentModel | None:
        """The model that an earlier server has stored, None where there is none.

        It is made again where what its rhythms were found in is not stored beside it.
        """
        content = self._derived.read(MODEL)
        try:
            if content is None:
                return None
            model, made_of = unpack_model(content)
        except StaleObject as error:
            log.warning("a model is made again", environment=self._state.name, reason=str(error))
            return None
        spectrum = self._stored_spectrum(model.revision)
        self._state.learn(model, spectrum, "" if spectrum is None else made_of)
        return model

    def restore_rows(self) -> None:
        """Takes the rows of pending maps that are stored, in the order in which they were made."""
        due = self._state.due()
        rows = [self._stored(content) for content in self._derived.read_all(map(row_name, due))]
        found = [(one.made, name, one) for name, one in zip(due, rows, strict=True) if one is not None]
        for _, name, one in sorted(found, key=lambda each: each[:2]):
            self._enter(name, one)

    def compare(self, name: str) -> None:
        """Computes, stores and enters the row of a pending map.

        Raises:
            RetraverseError: the storage cannot be used now, or the server is to end.
        """
        images = self._images(name)
        if images is None:
            self._state.dismiss(name)
            return
        found = self._row(name, images)
        self._derived.write(row_name(name), pack_row(found))
        self._enter(name, found)

    def outdated(self) -> bool:
        """Whether other maps are compared now than the model was made of."""
        return self._state.made_of != self._state.digest()

    def estimate(self) -> EnvironmentModel:
        """Estimates and stores the model of the maps that are compared now.

        Raises:
            RetraverseError: the storage cannot be used now, or the server is to end.
        """
        made_of = self._state.digest()
        names, hours, matrix, groups = self._state.compared()
        arguments = (hours, matrix, self._spectrum, groups)
        spectrum = self._cluster.map(of_maps, [arguments])[0]
        model = _model(self._state, len(names), spectrum)
        told = _told(model, spectrum)
        self._derived.write(SPECTRUM, pack_spectrum(told))
        self._derived.write(MODEL, pack_model(model, made_of))
        self._state.learn(model, told, made_of)
        log.info("estimated", environment=model.environment, maps=model.maps, revision=model.revision)
        return model

    def _stored_spectrum(self, revision: int) -> EnvironmentSpectrum | None:
        """What is stored of the rhythms of the model of a revision."""
        content = self._derived.read(SPECTRUM)
        try:
            found = None if content is None else unpack_spectrum(content)
        except StaleObject as error:
            log.warning("a spectrum is made again", environment=self._state.name, reason=str(error))
            return None
        return found if found is not None and found.revision == revision else None

    def _row(self, name: str, images: Along) -> Row:
        """The similarities of a map to all others of its group, and to itself last."""
        others, slots, bank = self._bank(name, images.kind)
        parts = [range(begin, min(begin + BLOCK, len(slots))) for begin in range(0, len(slots), BLOCK)]
        keys = [self._derived.key(images_name(other)) for other in others]
        blocks = [Block.of([keys[k] for k in part], self._storage.read) for part in parts]
        with held(blocks, [bank.take([slots[k] for k in part]) for part in parts]):
            found = self._cluster.map(part_of_row, [(images, block) for block in blocks])
        itself = row(images.values, Images.of(images.values), images.cell_height)
        return Row(images.kind, [*others, name], np.concatenate([*found, itself]), now_ns())

    def _bank(self, name: str, kind: Kind) -> tuple[list[str], list[int], Bank]:
        """The other maps of a map's group by their slots, these, and the bank with the images of them all."""
        group = self._state.group_of(name, kind)
        known, bank, inside = self._banks.get(group.key, (group, Bank(kind), {}))
        if known is not group:
            bank, inside = Bank(kind), {}
        self._banks[group.key] = group, bank, inside
        slots = dict(sorted((slot, other) for other, slot in group.slots().items() if other != name))
        missing = [(slot, other) for slot, other in slots.items() if inside.get(slot) != other]
        contents = self._derived.read_all(images_name(other) for _, other in missing)
        for (slot, other), content in zip(missing, contents, strict=True):
            images = self._unpacked(other, content)
            if images is None or images.kind != kind:
                raise StaleObject(f"the images of map {other} are stored no longer")
            bank.put(slot, images.values)
            inside[slot] = other
        return list(slots.values()), list(slots), bank

    def _enter(self, name: str, found: Row) -> None:
        if self._state.enter(name, found.kind, found.names, found.values):
            return
        log.info("a row is made again", environment=self._state.name, map=name)

    def _stored(self, content: bytes | None) -> Row | None:
        try:
            return None if content is None else unpack_row(content)
        except StaleObject as error:
            log.warning("a row is made again", environment=self._state.name, reason=str(error))
            return None

    def _images(self, name: str) -> Along | None:
        return self._unpacked(name, self._derived.read(images_name(name)))

    def _unpacked(self, name: str, content: bytes | None) -> Along | None:
        """A map's images; those that cannot be read are taken from its metadata again, None where it has none."""
        try:
            if content is not None:
                return unpack_images(content)
        except StaleObject as error:
            log.warning("images are read again", environment=self._state.name, map=name, reason=str(error))
        images = images_of(self._storage, self._state.name, name)
        if images is not None:
            self._derived.write(images_name(name), pack_images(images))
        return images


def _model(state: EnvironmentState, maps: int, spectrum: Spectrum) -> EnvironmentModel:
    return EnvironmentModel(
        environment=state.name,
        stamp=now_ns(),
        revision=state.model.revision + 1,
        maps=maps,
        periods_hours=spectrum.periods_hours.tolist(),
        weights=spectrum.weights.tolist(),
        phases=spectrum.phases.tolist(),
        significance=spectrum.significance.tolist(),
        trend_per_hour=spectrum.trend_per_hour,
        reason=spectrum.reason[:_TEXT],
    )


def _told(model: EnvironmentModel, spectrum: Spectrum) -> EnvironmentSpectrum:
    return EnvironmentSpectrum(
        environment=model.environment,
        revision=model.revision,
        frequencies=spectrum.frequencies,
        power=spectrum.power,
        levels=list(spectrum.levels.items()),
    )
