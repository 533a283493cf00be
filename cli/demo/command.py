"""``vtr demo``: every process on this machine with the synthetic world; teaches a route and repeats it."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from cli import output
from cli.arguments import JsonOption
from cli.demo.sensor import Sensor
from cli.errors import CommandError


def demo(
    out: Annotated[
        Path,
        typer.Option(
            "--output", "-o", "--out", metavar="DIR", help="Folder for the report, the plot, the logs and the map."
        ),
    ] = Path("demo"),
    sensor: Annotated[
        Sensor, typer.Option(help="What the robot drives by: a stereo camera, a lidar, or one camera's bearing.")
    ] = Sensor.STEREO,
    robots: Annotated[
        int,
        typer.Option(
            help="With 2, one robot teaches, and one that has never been there fetches its map from a fleet's server.",
            min=1,
            max=2,
        ),
    ] = 1,
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
    *,
    as_json: JsonOption = False,
) -> None:
    """Teach a route and repeat it in the synthetic world, with every process of a robot on this machine."""
    from cli.daylight import times
    from cli.demo.configuration import prepare
    from cli.demo.driver import DriverSettings
    from cli.demo.plot import plot_paths
    from cli.demo.report import make_report, print_report, write_report
    from cli.demo.story import Offset
    from cli.demo.telling import one_robot, two_robots
    from services.sensors.world import WorldSettings

    light = times(teach_time, repeat_time, WorldSettings(), by_night=sensor is Sensor.LIDAR)
    folder = out.expanduser().absolute()
    prepare(folder)
    offset = Offset(lateral_offset, heading_offset)
    with output.progress() as bar:
        task = bar.add_task("starting", total=1.0)
        tell = two_robots if robots == 2 else one_robot
        told = tell(
            folder,
            light,
            sensor,
            DriverSettings(speed=speed),
            offset,
            lambda text, part: bar.update(task, description=text, completed=part),
            lambda address: bar.console.print(f"watch the robot at {address}", highlight=False),
        )
    taught, repeated = told.taught, told.repeated
    if not repeated.drove():
        raise CommandError(f"the robot did not drive: {repeated.final_state}, {repeated.final_reason}")
    report = make_report(taught, repeated, dataclasses.asdict(offset), light, told.shared)
    write_report(report, folder / "report.json")
    plot_paths(taught, repeated, report, folder / "path.png")
    if as_json:
        output.emit(dataclasses.asdict(report), "", as_json=True)
    else:
        print_report(report, output.console())
        output.console().print(f"report: {folder / 'report.json'}   plot: {folder / 'path.png'}")
    if report.final_state != "Idle":
        raise CommandError(f"the repeat did not end at its goal: {report.final_state}, {report.final_reason}")
