"""All environments of the fleet: what is new comes in by one thread, and is compared by another."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import structlog

from common import messages as m
from common.errors import GraphError, RetraverseError, Unavailable
from services.fleet.analysis import Analysis
from services.fleet.cluster import Cluster, Stopped
from services.fleet.intake import Intake
from services.fleet.settings import Settings
from services.fleet.state import EnvironmentState
from services.fleet.store import Committed, Storage, committed

log = structlog.get_logger()

_RETRY_S = 1.0
_LONGEST_RETRY_S = 30.0
_POLL_S = 0.5
_REBUILD = "rebuild"


@dataclass(slots=True)
class _Environment:
    state: EnvironmentState
    intake: Intake
    analysis: Analysis
    read: bool = False
    restored: bool = False
    estimated: float = field(default_factory=time.monotonic)


class Environments:
    """The environments that have committed maps or reports."""

    def __init__(
        self,
        storage: Storage,
        cluster: Cluster,
        settings: Settings,
        publish: Callable[[m.EnvironmentModel], None],
        stop: threading.Event,
    ) -> None:
        """``publish`` is called with each new model, and with the stored one after a restart."""
        self._storage, self._cluster, self._settings = storage, cluster, settings
        self._publish, self._stop = publish, stop
        self._known: dict[str, _Environment] = {}
        self._asked: queue.SimpleQueue[m.Announcement | str | None] = queue.SimpleQueue()
        self._work = threading.Event()
        self._listed = False
        self._rebuilding: set[str] = set()

    def names(self) -> m.FleetEnvironments:
        """The environments, and what is still to be done for each.

        Raises:
            Unavailable: the storage has not been read yet.
        """
        self._check()
        states = [one.state for one in list(self._known.values())]
        return m.FleetEnvironments(
            maps={state.name: len(state.catalog) for state in states},
            pending={state.name: state.behind() + (state.name in self._rebuilding) for state in states},
        )

    def state(self, name: str) -> EnvironmentState:
        """What is known of an environment.

        Raises:
            Unavailable: the storage has not been read yet.
            GraphError: no map of it is shared.
        """
        self._check()
        if name not in self._known:
            names = ", ".join(sorted(self._known)[:8])
            others = f"; it knows {names}" if names else ": nobody has shared any"
            raise GraphError(f"the fleet has no maps of environment '{name}'{others}")
        return self._known[name].state

    def announce(self, told: m.Announcement) -> m.Done:
        """Takes note that something has been committed."""
        self._asked.put(told)
        return m.Done(text="noted")

    def rebuild(self) -> m.Done:
        """Lets everything derived be made again; plans go on over what is known meanwhile."""
        self._rebuilding.update(self._known)
        self._asked.put(_REBUILD)
        return m.Done(text="all that is derived is made again")

    def wake(self) -> None:
        """Lets both threads see that they are to end."""
        self._asked.put(None)
        self._work.set()

    def take_in(self) -> None:
        """Lists the storage at once and from time to time, and takes what is announced, until the end."""
        retry, due = _RETRY_S, time.monotonic()
        while not self._stop.is_set():
            try:
                if time.monotonic() >= due:
                    self._reconcile()
                    retry, due = _RETRY_S, time.monotonic() + self._settings.reconcile_s
                self._answer_one(max(0.0, due - time.monotonic()))
            except RetraverseError as error:
                log.warning("the storage cannot be read; trying again", reason=str(error), seconds=retry)
                due = time.monotonic() + retry
                retry = min(2.0 * retry, _LONGEST_RETRY_S)
                self._stop.wait(min(retry, _POLL_S))

    def compare(self) -> None:
        """Compares new maps and estimates models until the end."""
        while not self._stop.is_set():
            try:
                busy = [self._step(one) for one in list(self._known.values()) if one.read]
            except Stopped:
                return
            except RetraverseError as error:
                log.warning("maps cannot be compared now; trying again", reason=str(error))
                self._stop.wait(_RETRY_S)
                continue
            if not any(busy):
                self._work.wait(_POLL_S)
                self._work.clear()

    def _check(self) -> None:
        if not self._listed:
            raise Unavailable("the fleet's server has not read the storage yet: ask again in a moment")

    def _reconcile(self) -> None:
        listed = committed(self._storage)
        for name in self._known.keys() - listed.keys():
            listed[name] = Committed()
        for name, found in listed.items():
            one = self._environment(name, found)
            one.intake.reconcile(found)
            one.read = True
            self._work.set()
        self._listed = True

    def _answer_one(self, timeout: float) -> None:
        try:
            asked = self._asked.get(timeout=timeout)
        except queue.Empty:
            return
        if isinstance(asked, m.Announcement) and self._listed:
            found = self._environment(asked.environment, None)
            found.intake.announced(asked.robot, asked.map, asked.report)
            found.read = True
        elif asked == _REBUILD:
            listed = committed(self._storage)
            for name, known in self._known.items():
                known.intake.forget(listed.get(name, Committed()))
                self._rebuilding.discard(name)
        self._work.set()

    def _environment(self, name: str, listed: Committed | None) -> _Environment:
        """An environment, as an earlier server has left it where it is new to this one."""
        if name not in self._known:
            state = EnvironmentState(name, self._settings)
            intake = Intake(self._storage, state)
            if listed is not None:
                intake.restore(listed)
            analysis = Analysis(self._storage, self._cluster, state, self._settings)
            self._known[name] = _Environment(state, intake, analysis)
        return self._known[name]

    def _step(self, one: _Environment) -> bool:
        """Does the next thing that there is to do for an environment, and says whether there was any."""
        if not one.restored:
            stored = one.analysis.restore_model()
            if stored is not None:
                self._publish(stored)
            one.analysis.restore_rows()
            one.restored = True
        due = one.state.due()
        if due:
            one.analysis.compare(due[0])
        # Of fewer maps than before, as after a rebuild, no model is made until all of them are compared.
        late = time.monotonic() - one.estimated >= self._settings.model_every_s and one.state.grown()
        if one.analysis.outdated() and (len(due) <= 1 or late):
            self._publish(one.analysis.estimate())
            one.estimated = time.monotonic()
            return True
        return bool(due)
