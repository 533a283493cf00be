"""``vtr chaos``."""

from __future__ import annotations

import json
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Annotated

import typer

from cli import output
from cli.arguments import JsonOption
from cli.errors import CommandError


def chaos(
    *,
    runs: Annotated[
        int, typer.Option(min=1, help="How many faults happen now, those that had the fewest first.")
    ] = 100,
    each: Annotated[
        int | None, typer.Option(min=1, help="End when every kind of fault had so many, the earlier ones included.")
    ] = None,
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
    from cli.chaos.report import one, read, summary, table
    from cli.chaos.series import Case, cases, in_turn, outcomes
    from cli.demo.configuration import ROBOT, config_file, prepare, write_config
    from cli.demo.story import Story

    folder = out.expanduser().absolute()
    prepare(folder)
    config = config_file(folder, ROBOT)
    write_config(config, folder / "data")
    seen = read(folder / "outcomes.jsonl")
    todo = cases(only, seed)
    with output.progress() as bar:
        task = bar.add_task("starting", total=float(runs))
        with (
            Story(config, lambda text, _: bar.update(task, description=text), PROCESSES) as story,
            closing(Course(story, story.supervised.config.directory, metres)) as course,
        ):

            def told(case: Case) -> None:
                bar.update(task, description=f"{case[1].name}, in a {case[0]}")

            course.teach()
            turns = islice(in_turn(todo, seen, each), runs)
            for outcome in outcomes(course, story.supervised, turns, told):
                with (folder / "outcomes.jsonl").open("a", encoding="utf-8") as file:
                    file.write(json.dumps(one(outcome)) + "\n")
                seen.append(outcome)
                bar.advance(task)
    data = summary(seen)
    output.emit(data, table(data), as_json=as_json)
    if data["passed"] < data["runs"]:
        raise CommandError(f"{data['runs'] - data['passed']} of {data['runs']} faults were not taken as they must be")
