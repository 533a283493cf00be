"""Runs tasks in processes of their own, with one count of what they have done, and ends them with this one."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from types import TracebackType
from typing import TYPE_CHECKING, Self, TypeVar

from cli.errors import CommandError

if TYPE_CHECKING:
    from multiprocessing.sharedctypes import Synchronized

T = TypeVar("T")
R = TypeVar("R")

_POLL_S = 0.2
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


_count: Synchronized[int] | None = None


def advance() -> None:
    """Counts one step of a task, in the process that runs it."""
    if _count is not None:
        with _count.get_lock():
            _count.value += 1


def _begin(count: Synchronized[int]) -> None:
    """A worker's first act: an interrupt is the command's business, and without the command there is no worker."""
    global _count  # noqa: PLW0603, a process has one
    _count = count
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


class Pool:
    """Processes that run tasks; a context manager that leaves none of them behind, whatever ends it."""

    def __init__(self, processes: int, on_progress: Callable[[int], None]) -> None:
        """``on_progress`` is told, in this process, how many steps were done so far."""
        self._on_progress = on_progress
        # Spawned, as threads of numba and OpenCV do not survive a fork.
        context = multiprocessing.get_context("spawn")
        self._count: Synchronized[int] = context.Value("q", 0)
        self._before = set(multiprocessing.active_children())
        self._executor = ProcessPoolExecutor(processes, context, _begin, (self._count,))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            # What is at work now nobody waits for any more.
            for child in set(multiprocessing.active_children()) - self._before:
                child.terminate()
        self._executor.shutdown(cancel_futures=True)

    def map(self, task: Callable[[T], R], arguments: Iterable[T]) -> list[R]:
        """The results of a task for each argument, in their order; what a task raises is raised here.

        Raises:
            CommandError: a process was killed, as the system does when memory runs out.
        """
        for name in _ONE_THREAD:
            # Each process has a core of its own; more threads would only contend.
            os.environ.setdefault(name, "1")
        futures = [self._executor.submit(task, argument) for argument in arguments]
        try:
            while wait(futures, _POLL_S).not_done:
                self._on_progress(self._count.value)
                for future in futures:
                    # The first failure ends the others, which would take minutes yet.
                    if future.done():
                        future.result()
            return [future.result() for future in futures]
        except BrokenProcessPool:
            raise CommandError("a process of the evaluation was killed: is there enough memory?") from None
