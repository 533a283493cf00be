"""Asks the fleet's server what there is, again and again, in a thread of its own, while somebody looks."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import structlog

from common import messages as m
from common import topics
from common.bus import Bus, Subscription
from common.errors import BusError, NoAnswer
from services.console.errors import ConsoleError
from services.console.fleet.snapshot import Known, Route, Snapshot

log = structlog.get_logger()

_PERIOD_S = 0.2
"""How often the robots' states are read."""
_ASK_S = 1.0
"""How often the server is asked which environments have grown."""
_REREAD_S = 20.0
"""A catalog is read again this often even if it has not grown: what repeats tell of maps changes it too."""
_LOOKED_S = 60.0
"""An environment is followed this long after a page last asked about it."""
_TIMEOUT_S = 3.0
_PAGE = 1000

COMPARED = 100
"""Most maps of a similarity matrix."""


class Watch:
    """What is known of the fleet, kept up to date; safe for threads.

    Attributes:
        snapshot: the newest, replaced whole.
    """

    def __init__(self, bus: Bus, stop: threading.Event, unlinked: str = "", robots: str = "*") -> None:
        """``unlinked`` is what to say where the server does not answer because nothing leads to it.

        ``robots`` is the one whose presence and state are looked at, where that is not all of them.
        """
        self.snapshot = Snapshot()
        self._bus, self._stop, self._unlinked = bus, stop, unlinked
        self._lock = threading.RLock()
        self._models: Subscription[m.EnvironmentModel] = bus.subscribe(topics.MODEL, "*")
        self._robots = robots
        self._present = bus.robots(robots)
        self._states: Subscription[m.State] | None = None
        self._told: dict[str, m.EnvironmentModel] = {}
        self._looked: dict[str, float] = {}
        self._read: dict[str, float] = {}

    def look(self, environment: str) -> Known:
        """An environment as it is known, which is followed from now on.

        Raises:
            ConsoleError: the fleet has none of that name, or cannot be asked now.
        """
        self._looked[environment] = time.monotonic()
        if environment not in self.snapshot.environments:
            self.ask()
        known = self.snapshot.environments.get(environment)
        if known is None:
            names = ", ".join(sorted(self.snapshot.maps)) or "none yet"
            missing = self.snapshot.missing or f"the fleet has no environment '{environment}'; it has {names}"
            raise ConsoleError(missing)
        return known

    def similarities(self, environment: str, route: Route | None) -> m.Similarities:
        """How alike the newest maps of a route are; of that with most, where none is named.

        Raises:
            BusError: none was compared there, or the server cannot be asked now.
        """
        start, end = route or (None, None)
        query = m.SimilarityQuery(environment=environment, start=start, end=end, limit=COMPARED)
        answer: m.Similarities = self._bus.ask(topics.SIMILARITY, query, _TIMEOUT_S, name=environment)
        return answer

    def run(self, watched: Callable[[], bool]) -> None:
        """Follows the fleet until the end, while it is ``watched``."""
        due = 0.0
        while not self._stop.wait(_PERIOD_S):
            if not watched():
                self._rest()
                due = 0.0
                continue
            self.hear()
            if time.monotonic() >= due:
                self.ask()
                due = time.monotonic() + _ASK_S

    def hear(self) -> None:
        """Takes what robots have published since the last call."""
        with self._lock:
            if self._states is None:
                self._states = self._bus.subscribe(topics.STATE, robot=self._robots)
            states = dict(self.snapshot.states)
            while (received := self._states.poll()) is not None:
                states[received.source.robot] = received.message
            self.snapshot = replace(self.snapshot, present=self._present.alive(), states=states)

    def ask(self) -> None:
        """Asks the server once for everything that may have changed."""
        with self._lock:
            while (received := self._models.poll()) is not None:
                self._told[received.message.environment] = received.message
            try:
                names: m.FleetEnvironments = self._bus.ask(topics.ENVIRONMENTS, m.FleetQuery(), _TIMEOUT_S)
                environments = self._environments(names)
            except BusError as error:
                text = self._unlinked if isinstance(error, NoAnswer) and self._unlinked else str(error)
                self.snapshot = replace(self.snapshot, missing=text)
                return
            self.snapshot = replace(
                self.snapshot, missing="", maps=names.maps, pending=names.pending, environments=environments
            )

    def _rest(self) -> None:
        """Costs the robots' links nothing while nobody looks."""
        with self._lock:
            if self._states is not None:
                self._states.close()
                self._states = None
                self.snapshot = replace(self.snapshot, states={})

    def _environments(self, names: m.FleetEnvironments) -> Mapping[str, Known]:
        now = time.monotonic()
        self._looked = {name: when for name, when in list(self._looked.items()) if now - when < _LOOKED_S}
        wanted = self._looked.keys() & names.maps.keys()
        return {name: self._known(name, names.maps[name], names.pending.get(name, 0), now) for name in sorted(wanted)}

    def _known(self, name: str, count: int, pending: int, now: float) -> Known:
        """An environment, of which only that is asked which may have changed."""
        before = self.snapshot.environments.get(name, Known(name))
        entries, told, spectrum = before.entries, self._told.get(name), before.spectrum
        if before.version == 0 or len(entries) != count or now - self._read.get(name, 0.0) >= _REREAD_S:
            entries = tuple(self._catalog(name))
            self._read[name] = now
        if told is not None and (spectrum is None or spectrum.revision != told.revision):
            spectrum = self._spectrum(name)
        same = (entries, told, pending) == (before.entries, before.told, before.pending)
        if same and spectrum is before.spectrum and before.version:
            return before
        return Known(name, before.version + 1, entries, told, spectrum, pending)

    def _catalog(self, environment: str) -> list[m.CatalogEntry]:
        entries: list[m.CatalogEntry] = []
        while True:
            after = entries[-1].map if entries else None
            query = m.CatalogQuery(environment=environment, after=after, limit=_PAGE)
            page: m.Catalog = self._bus.ask(topics.CATALOG, query, _TIMEOUT_S, name=environment)
            entries += page.entries
            if not page.more or not page.entries:
                return entries

    def _spectrum(self, environment: str) -> m.EnvironmentSpectrum | None:
        """What the model's rhythms were found in; None where the server cannot tell now."""
        query = m.SpectrumQuery(environment=environment)
        try:
            found: m.EnvironmentSpectrum = self._bus.ask(topics.SPECTRUM, query, _TIMEOUT_S, name=environment)
        except BusError as error:
            log.info("no spectrum is told", environment=environment, reason=str(error))
            return None
        return found
