"""The emergency stop's latch, which outlives the process and the power."""

from __future__ import annotations

import json
import os
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


class LatchStoreError(OSError):
    """The latch's file cannot be written. The robot is stopped all the same."""


class EmergencyStop:
    """Latched by :meth:`engage` or :meth:`latch` until :meth:`reset`, across restarts. Safe for threads.

    The state is a small file. Where it does not exist nothing was ever latched; where it cannot be read or understood,
    the robot is taken to be stopped, since nobody can say that it is not.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._reason = _load(file)
        self._times = 0
        self._memory = threading.Lock()
        self._disk = threading.Lock()

    @property
    def reason(self) -> str | None:
        """Why it is latched; None where it is not."""
        return self._reason

    def latch(self, reason: str) -> None:
        """Latch without waiting for the disk: :meth:`save` is due. The first reason stays until the reset."""
        with self._memory:
            self._times += 1
            if self._reason is None:
                self._reason = reason

    def save(self) -> None:
        """Write the file as the latch is now.

        Raises:
            LatchStoreError: the file could not be written; a latch is held until the process ends.
        """
        with self._disk:
            _save(self._file, self._reason)

    def engage(self, reason: str) -> None:
        """Latch, at once and on disk.

        Raises:
            LatchStoreError: the file could not be written; it is latched until the process ends.
        """
        self.latch(reason)
        self.save()

    def reset(self) -> bool:
        """Release. It starts no motion: see :class:`services.safety.monitor.SafetyMonitor`.

        Returns whether it is released: not where it was latched again meanwhile.

        Raises:
            LatchStoreError: the file could not be written; it stays latched.
        """
        with self._disk:
            times = self._times
            _save(self._file, None)
            with self._memory:
                if self._times == times:
                    self._reason = None
                    return True
            _save(self._file, self._reason)
            return False


def _load(file: Path) -> str | None:
    try:
        content = json.loads(file.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValueError):
        return f"The file {file} of the emergency stop cannot be read."
    if isinstance(content, dict) and content.get("latched") is False:
        return None
    if isinstance(content, dict) and content.get("latched") is True and isinstance(content.get("reason"), str):
        return str(content["reason"])
    return f"The file {file} of the emergency stop makes no sense."


def _save(file: Path, reason: str | None) -> None:
    """Replace the file at once and wait until the disk has it, its name in the folder included."""
    content = {"latched": False} if reason is None else {"latched": True, "reason": reason}
    fresh = file.with_name(f"{file.name}.new")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with fresh.open("wb") as stream:
            stream.write(json.dumps(content).encode())
            stream.flush()
            os.fsync(stream.fileno())
        fresh.replace(file)
        folder = os.open(file.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        raise LatchStoreError(f"The emergency stop's file {file} cannot be written: {error}.") from error
