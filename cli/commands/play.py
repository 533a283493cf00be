"""``vtr play``."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from cli import arguments
from cli.arguments import ConfigOption, EnvironmentOption, JsonOption, StartPlaceOption
from cli.errors import CommandError

if TYPE_CHECKING:
    from common.config import RobotConfig
    from services.sensors.recordings.timeline import Timeline

_HELP = "A folder of stereo pairs or lidar scans, a ROS bag, or an MCAP file or folder of vtr record."


def play(
    data: Annotated[Path, typer.Argument(metavar="DATA", help=_HELP)],
    *,
    role: Annotated[
        Literal["teach"] | None, typer.Option("--as", help="teach: begin a map, play every frame into it, finish it.")
    ] = None,
    mapping: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="TOPIC=KEY", help="A bag's topic as one of ours; again for each. See the docs."),
    ] = None,
    topics: Annotated[
        str | None, typer.Option(metavar="KEYS", help="Only these of ours, as sensor/odometry,sensor/stereo/front.")
    ] = None,
    start: Annotated[float, typer.Option(metavar="SECONDS", min=0.0, help="Where in the recording it begins.")] = 0.0,
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", min=0.0, help="How much of the recording is played.")
    ] = None,
    rate: Annotated[float, typer.Option(min=0.05, max=100.0, help="Speed, 1 being the recorded one.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="From the beginning again, until ctrl-C.")] = False,
    info: Annotated[bool, typer.Option("--info", help="Say what would be played, and play nothing.")] = False,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="The camera in sensor/stereo/NAME; by default the estimator's.")
    ] = None,
    frames: Annotated[
        str | None, typer.Option(metavar="SLICE", help="Only these of a folder's frames, as start:stop:step.")
    ] = None,
    start_place: StartPlaceOption = None,
    end_place: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the map's last vertex.")] = None,
    environment: EnvironmentOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Play a recording on the robot's bus in the sensors' place, stamped now; --as teach makes a map of it."""
    from math import inf

    from cli import client, robot
    from cli.output import emit, progress
    from cli.player import PROCESS, Part, Player, check_part
    from common.messages import Command

    command = Command(
        action="teach",
        environment=arguments.name(environment, "--environment"),
        start_place=arguments.name(start_place, "--start-place"),
        end_place=arguments.name(end_place, "--end-place"),
    )
    if role is None and (environment or start_place or end_place):
        raise CommandError("--environment and places are those of a teach: give --as teach")
    if role == "teach" and loop:
        raise CommandError("--loop has no end, and a teach has one: leave one of them out")
    keys = frozenset(key.strip() for key in (topics or "").split(",") if key.strip())
    part = Part(start, inf if duration is None else duration, keys)
    if info:
        recording = _open(data, mapping or [], frames, name, None)
        check_part(recording, part)
        emit(_figures(recording), _described(recording), as_json=as_json)
        return
    configuration = robot.load(config)
    recording = _open(data, mapping or [], frames, name, configuration)
    check_part(recording, part)
    counted = sum(count for key, count in recording.counts.items() if not keys or key in keys)
    whole = not start and duration is None and not loop
    with client.connect(configuration, PROCESS) as bus, progress() as display:
        task = display.add_task(recording.name, total=counted if whole else None)
        player = Player(bus, recording, rate, part)
        played = (
            player.teach(command, _frames_key(configuration, name), lambda: display.advance(task))
            if role == "teach"
            else player.play(lambda: display.advance(task), loop=loop)
        )
    text = played.text or f"played {sum(played.messages.values())} messages in {played.seconds:.1f} s"
    emit({"recording": recording.name, **asdict(played)}, text, as_json=as_json)


def _open(
    data: Path, mapping: list[str], frames: str | None, name: str | None, configuration: "RobotConfig | None"
) -> "Timeline":
    """The recording, its sensors named as the robot's estimator has them."""
    from cli.frames import open_slice
    from services.estimator.settings import Settings
    from services.sensors.recordings.opening import Names, open_timeline
    from services.sensors.recordings.ros import parse_map

    settings = Settings() if configuration is None else configuration.settings("estimator", Settings)
    names = Names(arguments.name(name, "--name") or settings.camera, settings.scanner)
    wishes = parse_map(mapping)
    return open_timeline(data, wishes, names) if frames is None else open_slice(data, frames, "--frames", names)


def _frames_key(configuration: "RobotConfig", name: str | None) -> str:
    """The key of the frames that the robot localizes by."""
    from common import topics
    from services.estimator.settings import Settings

    settings = configuration.settings("estimator", Settings)
    if configuration.robot.sensor == "lidar":
        return topics.LIDAR.key.format(name=settings.scanner)
    return topics.STEREO.key.format(name=name or settings.camera)


def _figures(recording: "Timeline") -> dict[str, object]:
    seconds = (recording.end_ns - recording.start_ns) / 1e9
    sources = getattr(getattr(recording, "plan", None), "sources", {})
    return {"recording": recording.name, "seconds": seconds, "messages": recording.counts, "mapped": sources}


def _described(recording: "Timeline") -> str:
    figures = _figures(recording)
    lines = [f"{recording.name}: {figures['seconds']:.1f} s"]
    lines += [f"  {key}: {count} messages" for key, count in recording.counts.items()]
    sources = getattr(getattr(recording, "plan", None), "sources", {})
    lines += [f"  {source} is played as {key}" for source, key in sources.items()]
    if not getattr(recording, "whole", True):
        lines.append("  the recorder was cut short: what came until then is there")
    return "\n".join(lines)
