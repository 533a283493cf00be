"""A command in a terminal of its own, as a person over ssh has it: keys go in, a screen comes out."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import struct
import sys
import termios
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.processes import ROOT, eventually

_SEQUENCES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\x1b[()][A-B]")
_EXIT_S = 5.0


class Terminal:
    """``vtr`` with arguments, in a terminal of 80 columns; killed at the end of the block."""

    def __init__(self, *arguments: object, rows: int = 40, cwd: Path | None = None, **environment: str) -> None:
        self.raw = ""
        self.pid, self._terminal = pty.fork()
        if self.pid == 0:
            os.environ.update({"TERM": "xterm-256color", "PYTHONPATH": str(ROOT), "COLUMNS": "80", **environment})
            if cwd is not None:
                os.chdir(cwd)
            os.execv(sys.executable, [sys.executable, "-m", "cli", *map(str, arguments)])  # noqa: S606
        fcntl.ioctl(self._terminal, termios.TIOCSWINSZ, struct.pack("HHHH", rows, 80, 0, 0))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.pid:
            os.kill(self.pid, 9)
            os.waitpid(self.pid, 0)
        os.close(self._terminal)

    def read(self, seconds: float = 0.05) -> None:
        """Takes what the command has written, and waits as long for it."""
        if select.select([self._terminal], [], [], seconds)[0]:
            try:
                self.raw += os.read(self._terminal, 1 << 16).decode("utf-8", errors="replace")
            except OSError:  # Linux's way to say that the other end is gone
                time.sleep(seconds)

    def type(self, keys: str) -> None:
        """Presses keys."""
        os.write(self._terminal, keys.encode())

    def hold(self, key: str, seconds: float) -> None:
        """Holds a key, which repeats as a terminal's does."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.type(key)
            self.read(0.03)

    def screen(self) -> str:
        """What the last picture shows, without its colours."""
        return _SEQUENCES.sub("", self.raw.split("\x1b[H")[-1])

    def shows(self, *words: str, deadline: float = 20.0) -> str:
        """Waits for a picture with all of these words."""

        def found() -> str | None:
            self.read()
            screen = self.screen()
            return screen if all(word in screen for word in words) else None

        try:
            return eventually(found, f"the screen shows {words}", deadline)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.screen()}") from None

    def ends(self) -> int:
        """Waits for the command's end; its exit code."""

        def ended() -> tuple[int, int] | None:
            self.read()
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            return (pid, status) if pid else None

        _, status = eventually(ended, "the command ends", _EXIT_S)
        self.pid = 0
        known = -1
        while len(self.raw) > known:  # its last words
            known = len(self.raw)
            self.read()
        return os.waitstatus_to_exitcode(status)
