"""``vtr drive``."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from cli.arguments import ConfigOption, JsonOption

if TYPE_CHECKING:
    from cli.keyboard import Keys
    from common.bus import Bus

_PERIOD_S = 0.05


def drive(
    *,
    speed: Annotated[float, typer.Option(metavar="M/S", min=0.05, max=3.0, help="Speed, ahead and back.")] = 0.8,
    turn_rate: Annotated[float, typer.Option(metavar="RAD/S", min=0.05, max=3.0, help="Turn rate.")] = 0.5,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Drive the robot by hand while a map is taught: hold w or s, a or d, or the arrows; q ends."""
    from cli import client, robot
    from cli.keyboard import Keys, raw_terminal
    from cli.output import emit

    with raw_terminal() as terminal, client.connect(robot.load(config)) as bus:
        seconds, metres = _drive(bus, Keys(speed, turn_rate), terminal)
    data = {"seconds": round(seconds, 1), "metres": round(metres, 2)}
    emit(data, f"commanded {metres:.1f} m in {seconds:.0f} s", as_json=as_json)


def _drive(bus: "Bus", keys: "Keys", terminal: int) -> tuple[float, float]:
    """Publishes what the keys say until one of them ends it; the time that it took, and the metres commanded."""
    import time

    from cli.keyboard import is_end, read_keys
    from common import topics
    from common.messages import VelocityCommand, now_ns

    teleop, safety = bus.publisher(topics.TELEOP), bus.subscribe(topics.SAFETY_STATUS)
    begin = due = last = time.monotonic()
    metres = 0.0
    with _line() as show:
        while True:
            for key in read_keys(terminal, max(0.0, due - time.monotonic())):
                if is_end(key):
                    teleop.put(VelocityCommand(stamp=now_ns(), v=0.0, w=0.0))
                    return time.monotonic() - begin, metres
                keys.press(key, time.monotonic())
            now = time.monotonic()
            if now < due:
                continue
            v, w = keys.command(now)
            teleop.put(VelocityCommand(stamp=now_ns(), v=v, w=w))
            metres, last, due = metres + abs(v) * (now - last), now, max(due + _PERIOD_S, now)
            status = safety.fresh()
            held = "safety is silent" if status is None else "; ".join(reason.text for reason in status.reasons)
            show(f"{v:+.2f} m/s {w:+.2f} rad/s  {held}")


@contextmanager
def _line() -> Iterator[Callable[[str], None]]:
    """One line of standard error that is written again and again, cut to the terminal's width."""
    import shutil
    import sys

    def show(text: str) -> None:
        width = shutil.get_terminal_size().columns - 1
        sys.stderr.write(f"\r{text[:width]:{width}}\r")
        sys.stderr.flush()

    sys.stderr.write("w ahead, s back, a left, d right, space stop, q end\r\n")
    yield show
    show("")
