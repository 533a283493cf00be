"""``vtr soak``."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated

import typer

from cli import output
from cli.arguments import JsonOption
from cli.errors import CommandError


def soak(
    *,
    minutes: Annotated[float, typer.Option(min=1.0, help="How long the robot drives.")] = 60.0,
    kilometres: Annotated[
        float | None, typer.Option(min=0.05, help="Drive until it has come so far, however long that takes.")
    ] = None,
    metres: Annotated[float, typer.Option(min=70.0, help="Length of the network's ring.")] = 320.0,
    kill_every: Annotated[float, typer.Option(min=5.0, help="Seconds between two kills.")] = 30.0,
    lose: Annotated[float, typer.Option(min=0.0, max=0.9, help="Part of the frames that is lost.")] = 0.05,
    slip: Annotated[float, typer.Option(min=0.0, max=0.3, help="Of the wheels, standard deviation.")] = 0.03,
    seed: Annotated[int, typer.Option(help="Of goals and kills.")] = 1,
    out: Annotated[
        Path,
        typer.Option("--output", "-o", "--out", metavar="DIR", help="Folder for the robot's data, logs and report."),
    ] = Path("soak"),
    as_json: JsonOption = False,
) -> None:
    """Drive from goal to goal on a network of routes, while frames are lost and processes are killed."""
    from cli.chaos.course import PROCESSES
    from cli.demo.configuration import ROBOT, config_file, prepare, write_config
    from cli.demo.story import Story
    from cli.soak.drive import Drive, Soak
    from cli.soak.network import graph_of, teach, world_tables
    from cli.soak.report import report, table
    from common.posegraph import check

    folder = out.expanduser().absolute()
    prepare(folder)
    config = config_file(folder, ROBOT)
    write_config(config, folder / "data")
    with config.open("a", encoding="utf-8") as file:
        file.write(world_tables(metres, slip))
    with output.progress() as bar:
        task = bar.add_task("starting", total=100.0)
        with Story(config, lambda text, _: bar.update(task, description=text), PROCESSES) as story:
            network = teach(story)
            story.put_down(*story.route()[0])
            begin = time.monotonic()

            def over(seen: Drive) -> bool:
                passed = (time.monotonic() - begin) / 60.0
                share = passed / minutes if kilometres is None else seen.kilometres() / kilometres
                done = f"{seen.reached} goals, {seen.kilometres():.2f} km, {sum(seen.kills.values())} kills"
                bar.update(task, description=done, completed=100.0 * min(share, 1.0))
                return share >= 1.0

            seen = Soak(story, network.maps[0], kill_every=kill_every, lose=lose, seed=seed).run(over)
            minutes_driven = (time.monotonic() - begin) / 60.0
            data = report(network, seen, minutes_driven, check(graph_of(story)))
    (folder / "soak.json").write_text(json.dumps(data, indent=1), encoding="utf-8")
    output.emit(data, table(data), as_json=as_json)
    if data["interventions"] or data["graph"]:
        raise CommandError(f"{len(data['interventions'])} interventions, {len(data['graph'])} faults in the graph")
