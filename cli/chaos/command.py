"""``vtr chaos``."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Annotated

import typer

from cli import output
from cli.arguments import JsonOption
from cli.errors import CommandError


def chaos(
    *,
    runs: Annotated[int, typer.Option(min=1, help="How many faults happen now, each fault in turn.")] = 100,
    only: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Only faults whose name holds this, as 'kill' or 'estimator'.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the order of the faults.")] = 1,
    metres: Annotated[float, typer.Option(min=20.0, help="Of the route that is driven again and again.")] = 60.0,
    out: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            "--out",
            metavar="DIR",
            help="Folder for data and logs; goes on where earlier runs in it ended.",
        ),
    ] = Path("chaos"),
    as_json: JsonOption = False,
) -> None:
    """Let faults happen to every process of a robot that teaches and repeats, and measure what it makes of them."""
    from cli.chaos.course import PROCESSES, Course
    from cli.chaos.faults import Doing, Fault, all_faults
    from cli.chaos.judge import unfinished
    from cli.chaos.report import one, read, summary, table
    from cli.chaos.run import run
    from cli.demo.configuration import ROBOT, config_file, prepare, write_config
    from cli.demo.story import Story

    both: tuple[Doing, ...] = ("repeat", "teach")
    plan: list[tuple[Doing, Fault]] = [
        (doing, fault) for doing in both for fault in all_faults(doing) if only is None or only in fault.name
    ]
    if not plan:
        raise CommandError(f"no fault's name holds '{only}'")
    random.Random(seed).shuffle(plan)  # noqa: S311, chance for tests
    folder = out.expanduser().absolute()
    prepare(folder)
    write_config(config_file(folder, ROBOT), folder / "data")
    outcomes = read(folder / "outcomes.jsonl")
    earlier = len(outcomes)
    with output.progress() as bar:
        task = bar.add_task("starting", total=float(runs))
        with Story(config_file(folder, ROBOT), lambda text, _: bar.update(task, description=text), PROCESSES) as story:
            course = Course(story, story.supervised.config.directory, metres)
            course.teach()
            for number in range(runs):
                doing, fault = plan[(earlier + number) % len(plan)]
                bar.update(task, description=f"{fault.name}, in a {doing}", completed=float(number))
                try:
                    outcomes.append(run(course, story.supervised, fault, doing))
                except CommandError as error:
                    outcomes.append(unfinished(fault, doing, str(error)))
                with (folder / "outcomes.jsonl").open("a", encoding="utf-8") as file:
                    file.write(json.dumps(one(outcomes[-1])) + "\n")
    data = summary(outcomes)
    output.emit(data, table(data), as_json=as_json)
    if data["passed"] < data["runs"]:
        raise CommandError(f"{data['runs'] - data['passed']} of {data['runs']} faults were not taken as they must be")
