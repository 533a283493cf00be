"""``vtr demo``: every process on this machine with the synthetic world; teaches a route and repeats it."""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from cli import output
from cli.demo.sensor import Sensor
from cli.errors import CommandError

ROBOT_NAME = "demo"
CONFIG_START = f'[robot]\nname = "{ROBOT_NAME}"\n'
"""How the configuration of a demo begins."""


def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder for the report, the plot, the logs and the map.")] = Path(
        "demo"
    ),
    sensor: Annotated[
        Sensor, typer.Option(help="What the robot drives by: a stereo camera, a lidar, or one camera's bearing.")
    ] = Sensor.STEREO,
    speed: Annotated[float, typer.Option(help="Speed of the teaching human, m/s.", min=0.2, max=2.0)] = 1.2,
    lateral_offset: Annotated[float, typer.Option(help="Metres beside the path at which the repeat starts.")] = 0.3,
    heading_offset: Annotated[float, typer.Option(help="Degrees off the path at which the repeat starts.")] = 5.0,
    teach_time: Annotated[
        str | None,
        typer.Option(metavar="HH:MM", help="Time of day of the teach, UTC; noon is at 11:00 in the world [default]."),
    ] = None,
    repeat_time: Annotated[
        str | None, typer.Option(metavar="HH:MM", help="Time of day of the repeat, UTC; by default the teach's.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,  # noqa: FBT002
) -> None:
    """Teach a route and repeat it in the synthetic world, with every process of a robot on this machine."""
    from cli.daylight import times
    from cli.demo.driver import DriverSettings
    from cli.demo.plot import plot_paths
    from cli.demo.report import make_report, print_report, write_report
    from cli.demo.story import Offset, Story, write_config
    from services.sensors.world import WorldSettings

    light = times(teach_time, repeat_time, WorldSettings(), by_night=sensor is Sensor.LIDAR)
    folder = out.expanduser().absolute()
    prepare(folder)
    write_config(folder / "robot.toml", folder / "data", light, sensor)
    offset = Offset(lateral_offset, heading_offset)
    with output.progress() as bar:
        task = bar.add_task("starting", total=1.0)
        with Story(
            folder / "robot.toml", lambda text, part: bar.update(task, description=text, completed=part)
        ) as story:
            map_id, taught = story.teach(story.route(), DriverSettings(speed=speed))
            if light.repeat != light.teach:
                story.set_time(light.repeat)
            repeated = story.repeat(map_id, taught.poses()[0], offset, timeout=3.0 * taught.driving_seconds() + 30.0)
    if not repeated.drove():
        raise CommandError(f"the robot did not drive: {repeated.final_state}, {repeated.final_reason}")
    report = make_report(taught, repeated, dataclasses.asdict(offset), light)
    write_report(report, folder / "report.json")
    plot_paths(taught, repeated, report, folder / "path.png")
    if as_json:
        output.emit(dataclasses.asdict(report), "", as_json=True)
    else:
        print_report(report, output.console())
        output.console().print(f"report: {folder / 'report.json'}   plot: {folder / 'path.png'}")
    if report.final_state != "Idle":
        raise CommandError(f"the repeat did not end at its goal: {report.final_state}, {report.final_reason}")


def prepare(folder: Path) -> None:
    """Makes the demo's folder, or clears away the robot of the last demo there; what is another's stays untouched.

    Raises:
        CommandError: the folder cannot be written to, holds another robot's configuration, or a demo runs in it.
    """
    from cli.supervision.supervised import Supervised

    config = folder / "robot.toml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        if not config.exists():
            return
        if not config.read_text(encoding="utf-8").startswith(CONFIG_START):
            raise CommandError(f"{config} is not of a demo: give another folder with --out")
        if Supervised(config).running():
            raise CommandError(f"a demo is running in {folder}: wait for its end, or give another folder with --out")
        shutil.rmtree(folder / "data" / ROBOT_NAME, ignore_errors=True)
    except OSError as error:
        raise CommandError(f"cannot write to {folder}: {error.strerror}; give another folder with --out") from None
