"""The life of a service: start, presence, health, clean stop.

A service's ``__main__.py`` is one line, ``run("tracker", main)``, and its ``main(service)`` subscribes and loops until
``service.stop`` is set.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import faulthandler
import itertools
import os
import signal
import socket
import sys
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Literal

import numpy as np
import psutil
import structlog

from common import config, logs, memory, topics
from common.access.link import client_settings, router_settings
from common.bus import Bus
from common.errors import RetraverseError
from common.messages import Health, Percentiles, now_ns
from common.service_manager import ServiceManager

_HEALTH_PERIOD_S = 1.0
_TIDY_EVERY = 30
"""Reports of health between two times that freed memory is given back."""
_JOIN_DEADLINE_S = 0.5
_STOP_DEADLINE_S = 1.7
_FORCED = 70
"""Exit status of a process that had to be ended by force."""

_CLOCK_JUMP_S = 0.5
_SAMPLES_KEPT = 1000

log = structlog.get_logger()


class Service:
    """A running process: its configuration, its bus, and the event that ends it."""

    def __init__(self, name: str, configuration: config.RobotConfig, bus: Bus) -> None:
        self.name = name
        self.config = configuration
        self.bus = bus
        self.stop = threading.Event()
        self.failed = False
        self._threads: list[threading.Thread] = []
        self._durations: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=_SAMPLES_KEPT))
        self._counts: dict[str, int] = defaultdict(int)
        self._process = psutil.Process()
        self._started = now_ns()
        self._manager = ServiceManager()
        self._working: dict[object, float] = {}

    def ready(self) -> None:
        """Shows this process to all others: from now on its queries are served and its inputs are taken."""
        self.bus.present()
        self._manager.ready()
        log.info("ready")

    @contextlib.contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Times a stage of the work for the health report; a stage without an end shows that this process hangs."""
        token, start = object(), time.perf_counter()
        self._working[token] = time.monotonic()
        try:
            yield
        finally:
            del self._working[token]
            self.record(name, time.perf_counter() - start)

    def hangs(self, limit_s: float) -> bool:
        """Whether a stage of the work has been going on for longer than ``limit_s`` seconds."""
        return time.monotonic() - min(list(self._working.values()), default=float("inf")) > limit_s

    def record(self, name: str, seconds: float) -> None:
        """Adds a duration to a stage of the health report."""
        self._durations[name].append(seconds)
        self._counts[name] += 1

    def thread(self, target: Callable[[], None], name: str) -> threading.Thread:
        """Starts a thread whose uncaught error ends the process, so that the supervisor starts it anew.

        It should return when ``stop`` is set: the bus stays open for it for half a second more.
        """

        def guarded() -> None:
            try:
                target()
            except Exception:
                # After the stop, an error is most likely that of a bus which has gone.
                if not self.stop.is_set():
                    log.exception("a thread failed", thread=name)
                    self.failed = True
                    self.stop.set()

        thread = threading.Thread(target=guarded, name=name, daemon=True)
        self._threads.append(thread)
        thread.start()
        return thread

    def end(self) -> None:
        """Ends this service's threads, and waits for them to return, but never long."""
        self.stop.set()
        self._manager.stopping()
        deadline = time.monotonic() + _JOIN_DEADLINE_S
        for thread in self._threads:
            thread.join(max(0.0, deadline - time.monotonic()))

    def report_health(self) -> None:
        """Publishes the health of this process once a second until it stops, and gives systemd's watchdog its due.

        A jump of the clock is logged here, and freed memory given back.
        """
        publisher = self.bus.publisher(topics.HEALTH, self.name)
        self._process.cpu_percent()
        offset = time.time() - time.monotonic()
        for count in itertools.count(1):
            if self.stop.wait(_HEALTH_PERIOD_S):
                return
            publisher.put(self._health())
            self._show_life()
            if count % _TIDY_EVERY == 0:
                memory.give_back_freed()
            jumped = time.time() - time.monotonic() - offset
            if abs(jumped) > _CLOCK_JUMP_S:
                log.warning("the clock jumped; no decision depends on it", seconds=round(jumped, 3))
                offset += jumped

    def _show_life(self) -> None:
        limit = self._manager.watchdog_s
        if limit is not None and not self.hangs(limit):
            self._manager.alive()

    def _health(self) -> Health:
        rates, dropped = self.bus.statistics.collect()
        stages = {}
        for name, durations in list(self._durations.items()):
            p50, p99 = np.percentile(np.array(durations) * 1e3, [50, 99])
            stages[name] = Percentiles(count=self._counts[name], p50=round(p50, 3), p99=round(p99, 3))
        return Health(
            stamp=now_ns(),
            process=self.name,
            pid=os.getpid(),
            started=self._started,
            cpu=self._process.cpu_percent() / 100.0,
            memory_mb=self._process.memory_info().rss / 1e6,
            rates=rates,
            dropped=dropped,
            stages=stages,
        )


def run(name: str, main: Callable[[Service], None], mode: Literal["client", "router"] = "client") -> None:
    """Runs a service until SIGTERM or SIGINT, and ends the process with a status that says how it went."""
    parser = argparse.ArgumentParser(prog=f"python -m services.{name}")
    parser.add_argument("--config", type=Path, default=os.environ.get("VTR_CONFIG"), help="the robot's TOML file")
    path: Path | None = parser.parse_args().config
    if path is None:
        parser.error("name the robot's configuration with --config, or in VTR_CONFIG")
    _die_with_parent()
    faulthandler.enable()  # a watchdog's SIGABRT leaves the traces of a process that hangs
    try:
        configuration = config.load(Path(path))
        logs.configure(configuration.robot.name, name, configuration.robot.log_level, json=configuration.robot.log_json)
        status = _live(name, configuration, main, mode)
    except RetraverseError as error:
        sys.exit(f"{name}: {error}")
    # The interpreter's own end would unwind threads that are inside native code, which aborts the process.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def _live(
    name: str, configuration: config.RobotConfig, main: Callable[[Service], None], mode: Literal["client", "router"]
) -> int:
    robot, table = configuration.robot.name, configuration.bus
    uplink = table.fleet if mode == "router" else None
    access = router_settings(configuration) if mode == "router" else client_settings(configuration, name)
    with Bus(
        robot, name, table.endpoint, shared_memory=table.shared_memory, mode=mode, uplink=uplink, access=access
    ) as bus:
        service = Service(name, configuration, bus)
        _stop_on_signals(service)
        service.thread(service.report_health, "health")
        log.info("started", pid=os.getpid())
        try:
            main(service)
        except RetraverseError as error:
            log.error("stopped", reason=str(error))  # noqa: TRY400, the sentence is meant for a person
            service.failed = True
        except Exception:
            log.exception("failed")
            service.failed = True
        service.end()
        log.info("ended")
    return 1 if service.failed else 0


def _stop_on_signals(service: Service) -> None:
    """Lets SIGTERM and SIGINT end the service, and ends it by force when its main loop does not return in time.

    Python runs a signal's handler in the main thread alone, which may be inside native code for long: the signal's
    number, written to a socket at once, wakes a thread of its own instead.
    """
    awake, waker = socket.socketpair()
    waker.setblocking(False)

    def listen() -> None:
        awake.recv(1)
        service.stop.set()

    def force() -> None:
        service.stop.wait()
        time.sleep(_STOP_DEADLINE_S)
        log.error("did not stop in time")
        faulthandler.dump_traceback()
        os._exit(_FORCED)

    def handle(_signal: int, _frame: FrameType | None) -> None:
        service.stop.set()

    signal.set_wakeup_fd(waker.detach(), warn_on_full_buffer=False)
    signal.signal(signal.SIGTERM, handle)
    signal.signal(signal.SIGINT, handle)
    for target in (listen, force):
        threading.Thread(target=target, name=target.__name__, daemon=True).start()


def _die_with_parent() -> None:
    """Asks Linux to send SIGTERM when the supervisor is killed, so that no robot process is left without one."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG
