"""``vtr leave-one-out``: Table I of *Shady Dealings* in the synthetic world."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cli.arguments import JsonOption
from cli.errors import CommandError


def leave_one_out(
    times: Annotated[int, typer.Option(help="Times of day, evenly from the first to the last.", min=2, max=48)] = 8,
    first: Annotated[str, typer.Option(metavar="HH:MM", help="The first, UTC; noon is at 11:00.")] = "04:40",
    last: Annotated[str, typer.Option(metavar="HH:MM", help="The last, UTC.")] = "17:30",
    *,
    out: Annotated[
        Path,
        typer.Option(
            "--output", "-o", "--out", metavar="DIR", help="Folder for the table, the figures and the pictures."
        ),
    ] = Path("leave-one-out"),
    length: Annotated[
        float | None, typer.Option(metavar="METRES", help="Drive only the route's beginning.", min=3.0)
    ] = None,
    experiences: Annotated[
        int, typer.Option(help="Also with repeats at as many other times recorded in the map.", min=0, max=20)
    ] = 0,
    wind: Annotated[
        bool, typer.Option("--wind/--still", help="Leaves and grass stand otherwise on every drive, or not.")
    ] = True,
    seed: Annotated[int, typer.Option(help="Of the drives' sway and of their cameras' noise.", min=0)] = 1,
    processes: Annotated[int, typer.Option(help="Processes to share the work.", min=1, max=64)] = 2,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="Settings of the pipeline: the table estimator of this robot.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Drive one route at many times of a clear day, and localize each drive on every other one taught."""
    from cli import output
    from cli.leave_one_out.report import figures, for_reader, save
    from cli.leave_one_out.study import Study, evaluate, times_of_day
    from cli.offline_settings import estimator_settings
    from services.sensors.world.traversal import DrivingSettings

    study = Study(
        times=times_of_day(first, last, times),
        estimator=estimator_settings(config),
        driving=DrivingSettings(length=length),
        seed=seed,
        wind=wind,
        experiences=experiences,
    )
    folder = out.expanduser().absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CommandError(f"cannot make the folder {folder}: {error.strerror}") from None
    with output.progress() as bar:
        task = bar.add_task(f"{times} drives", total=study.steps())
        results = evaluate(study, folder, processes, lambda done: bar.update(task, completed=done))
    report = figures(results)
    written = save(results, report, folder)
    output.emit({**report, "written": [str(path) for path in written]}, for_reader(report), as_json=as_json)
