"""Where rows and models are computed: threads of this process, or any Dask cluster."""

from __future__ import annotations

import contextlib
import importlib
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

import structlog

from common.errors import RetraverseError

T = TypeVar("T")
Client = Any
"""Dask's client, which has no types."""

_CONNECT_S = 3
_POLL_S = 0.5
_PATIENCE_S = 60.0

log = structlog.get_logger()


class Stopped(RetraverseError):
    """The server is to end, and what it was computing will be computed after its next start."""


class Cluster:
    """Computes functions of plain values, and does so again until it has their results.

    A worker that is killed costs time only: Dask gives its tasks to another one. A scheduler that is gone is waited
    for.
    """

    def __init__(self, scheduler: str, threads: int, scratch: Path, stop: threading.Event) -> None:
        """``scheduler`` is the address of a Dask scheduler; where it is empty, this process has threads of its own."""
        self._scheduler, self._threads, self._scratch, self._stop = scheduler, threads, scratch, stop
        self._client: Client | None = None

    def map(self, function: Callable[..., T], arguments: Sequence[tuple[Any, ...]]) -> list[T]:
        """The function's value for each of some arguments, in their order.

        Raises:
            Stopped: the server is to end.
            Exception: whatever the function itself raised.
        """
        dask = _distributed()
        lost = OSError, TimeoutError, dask.CancelledError, dask.scheduler.KilledWorker, dask.comm.CommClosedError
        while True:
            try:
                client = self._connected()
                return self._gathered(client, [client.submit(function, *one, pure=False) for one in arguments])
            except lost as error:
                log.warning("the cluster has failed; trying again", reason=str(error) or type(error).__name__)
                self.close()
            if self._stop.wait(1.0):
                raise Stopped("the server ends")

    def close(self) -> None:
        """Lets go of the cluster."""
        client, self._client = self._client, None
        if client is not None:
            client.close(timeout=1)

    def _connected(self) -> Client:
        # The matrix of a model is tens of megabytes, and sent once.
        importlib.import_module("dask").config.set({"distributed.admin.large-graph-warning-threshold": "1GB"})
        if self._client is None and self._scheduler:
            self._client = _distributed().Client(self._scheduler, timeout=_CONNECT_S, set_as_default=False)
        elif self._client is None:
            self._client = _of_threads(self._threads, self._scratch)
        return self._client

    def _gathered(self, client: Client, futures: list[Any]) -> list[Any]:
        began, warned = time.monotonic(), False
        while not all(future.done() for future in futures):
            if self._stop.wait(0.0):
                raise Stopped("the server ends")
            if client.status not in {"running", "connecting"}:
                raise OSError("the connection to the scheduler is lost")
            if not warned and time.monotonic() - began > _PATIENCE_S:
                warned = True
                log.warning("waiting for the cluster's workers", seconds=round(_PATIENCE_S))
            _wait_for(client, futures)
        return cast("list[Any]", client.gather(futures))


def _of_threads(count: int, scratch: Path) -> Client:
    """A scheduler and a worker with so many threads in this process; their web pages are empty, and seen from here."""
    pages = "127.0.0.1:0"
    with importlib.import_module("dask").config.set(
        {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}
    ):
        return _distributed().Client(
            processes=False,
            n_workers=1,
            threads_per_worker=count,
            dashboard_address=pages,
            worker_dashboard_address=pages,
            local_directory=str(scratch),
            memory_limit=0,
            set_as_default=False,
        )


def _wait_for(client: Client, futures: list[Any]) -> None:
    """Waits until all are done, but not for long."""
    with contextlib.suppress(TimeoutError), client.as_current():
        _distributed().wait(futures, timeout=_POLL_S)


def _distributed() -> Any:  # noqa: ANN401, it has no types
    """Dask's distributed package: its import takes half a second, which only who computes has to wait."""
    return importlib.import_module("distributed")
