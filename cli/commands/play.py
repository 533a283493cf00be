"""``vtr play``."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import typer

from cli import arguments
from cli.arguments import ConfigOption, EnvironmentOption, JsonOption
from cli.errors import CommandError


def play(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="A folder of stereo pairs.")],
    *,
    role: Annotated[
        Literal["teach"] | None, typer.Option("--as", help="teach: begin a map, play every frame into it, finish it.")
    ] = None,
    rate: Annotated[float, typer.Option(min=0.05, max=100.0, help="Speed, 1 being the recorded one.")] = 1.0,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="The camera in sensor/stereo/NAME; by default the estimator's.")
    ] = None,
    frames: Annotated[str | None, typer.Option(metavar="SLICE", help="Only these frames, as start:stop:step.")] = None,
    start_place: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the map's first vertex.")] = None,
    end_place: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the map's last vertex.")] = None,
    environment: EnvironmentOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Play a recording on the robot's bus in the sensors' place, stamped now; --as teach makes a map of it."""
    from cli import client, robot
    from cli.frames import open_frames
    from cli.output import emit, progress
    from cli.player import PROCESS, Player
    from common.messages import Command
    from services.estimator.settings import Settings

    configuration = robot.load(config)
    camera = arguments.name(name, "--name") or configuration.settings("estimator", Settings).camera
    command = Command(
        action="teach",
        environment=arguments.name(environment, "--environment"),
        start_place=arguments.name(start_place, "--start-place"),
        end_place=arguments.name(end_place, "--end-place"),
    )
    if role is None and (environment or start_place or end_place):
        raise CommandError("--environment and places are those of a teach: give --as teach")
    recording = open_frames(data, frames, "--frames")
    with client.connect(configuration, PROCESS) as bus, progress() as display:
        task = display.add_task(recording.name, total=len(recording))
        player = Player(bus, recording, camera, rate)
        played = (
            player.teach(command, lambda: display.advance(task))
            if role == "teach"
            else player.play(lambda: display.advance(task))
        )
    text = played.text or f"played {played.frames} frames in {played.seconds:.1f} s"
    emit({"recording": recording.name, **asdict(played)}, text, as_json=as_json)
