"""Driving by the keys of a terminal: which keys mean what, and for how long a key counts as held."""

from __future__ import annotations

import os
import select
import signal
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from cli.errors import CommandError

HELD_S = 0.7
"""A terminal tells no release: a key repeats while it is held, after up to two thirds of a second at first."""

_ARROWS = {"\x1b[A": "w", "\x1b[B": "s", "\x1b[C": "d", "\x1b[D": "a"}
_ENDS = {"q", "\x03", "\x04"}


@dataclass(slots=True)
class Keys:
    """The command that the pressed keys mean.

    ``w`` and ``s`` drive straight, ahead and back; ``a`` and ``d`` turn, without changing the speed; a space stops. Any
    of them counts for :data:`HELD_S` after its last press, and then the robot stops.

    Attributes:
        speed: of ahead and back, m/s.
        turn_rate: of a turn, rad/s.
    """

    speed: float
    turn_rate: float
    _v: float = 0.0
    _w: float = 0.0
    _pressed: float = float("-inf")

    def press(self, key: str, now: float) -> None:
        """Takes a key pressed at a monotonic time (s); keys that mean nothing change nothing."""
        if now - self._pressed > HELD_S:
            self._v = self._w = 0.0
        if key in ("w", "s"):
            self._v, self._w = (self.speed if key == "w" else -self.speed), 0.0
        elif key in ("a", "d"):
            self._w = self.turn_rate if key == "a" else -self.turn_rate
        elif key == " ":
            self._v = self._w = 0.0
        else:
            return
        self._pressed = now

    def command(self, now: float) -> tuple[float, float]:
        """Speed (m/s) and turn rate (rad/s) at a monotonic time (s)."""
        return (self._v, self._w) if now - self._pressed <= HELD_S else (0.0, 0.0)


def is_end(key: str) -> bool:
    """Whether a key ends the driving."""
    return key in _ENDS


@contextmanager
def raw_terminal() -> Iterator[int]:
    """Standard input as a terminal that hands over each key at once and shows none; as it was at the end.

    Raises:
        CommandError: it is no terminal.
    """
    if not sys.stdin.isatty():
        raise CommandError("vtr drive reads keys, and there is no terminal here to press them at")
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # it gives the terminal back as well
    tty.setraw(terminal, termios.TCSADRAIN)
    try:
        yield terminal
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def read_keys(terminal: int, timeout: float) -> list[str]:
    """The keys pressed since the last call, after waiting ``timeout`` seconds for the first; arrows as letters.

    A terminal that is gone reads as a key that ends the driving.
    """
    if not select.select([terminal], [], [], timeout)[0]:
        return []
    text = os.read(terminal, 256).decode("utf-8", errors="ignore")
    for arrow, letter in _ARROWS.items():
        text = text.replace(arrow, letter)
    return list(text) or ["q"]
