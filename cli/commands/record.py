"""``vtr record``."""

import threading
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.arguments import ConfigOption, JsonOption

if TYPE_CHECKING:
    from cli.recorder import Recorded


def record(
    *,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder of the files.")] = Path(),
    topics: Annotated[
        str | None,
        typer.Option(metavar="KEYS", help="Only these topics, as sensor/stereo/front,state; by default all."),
    ] = None,
    split_size: Annotated[float, typer.Option(metavar="MB", min=1.0, help="A new file begins after this.")] = 2000.0,
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", min=0.1, help="How long; by default until ctrl-C.")
    ] = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Record the robot's bus to MCAP files until ctrl-C: for vtr play, vtr replay-diff, and Foxglove's viewer."""
    from cli import client, recorder, robot
    from cli.output import emit, progress
    from services.sensors.recordings.mcap import McapWriter

    configuration = robot.load(config)
    keys = [] if topics is None else [key.strip() for key in topics.split(",") if key.strip()]
    chosen = recorder.choose(keys)
    text = configuration.path.read_text(encoding="utf-8")
    folder = output.expanduser().absolute()
    with (
        client.connect(configuration, recorder.PROCESS) as bus,
        McapWriter(folder, configuration.robot.name, round(split_size * 1e6), text) as writer,
        progress() as display,
    ):
        task = display.add_task("recording", total=None)

        def show(so_far: "Recorded") -> None:
            total = sum(so_far.messages.values())
            display.update(task, description=f"{total} messages, {so_far.bytes / 1e6:.0f} MB, {_lost(so_far)}")

        recorded = recorder.BusRecorder(bus, chosen, writer).run(_stop_after(duration), show)
    total = sum(recorded.messages.values())
    summary = f"{total} messages in {recorded.seconds:.1f} s, {recorded.bytes / 1e6:.1f} MB, {_lost(recorded)}"
    emit(asdict(recorded), "\n".join([summary, *recorded.files]), as_json=as_json)


def _lost(recorded: "Recorded") -> str:
    """What never came, as gaps in the senders' numbers tell, in words."""
    lost = ", ".join(f"{count} of {key}" for key, count in sorted(recorded.lost.items()))
    return f"lost: {lost}" if lost else "none lost"


def _stop_after(seconds: float | None) -> threading.Event:
    """Set by the first SIGINT or SIGTERM, or after so many seconds."""
    import signal

    stop = threading.Event()
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stop.set())
    if seconds is not None:
        timer = threading.Timer(seconds, stop.set)
        timer.daemon = True
        timer.start()
    return stop
