"""``vtr maps ls``, ``vtr maps show``, ``vtr maps rm``."""

import sys
from typing import Annotated

import typer

from cli import arguments
from cli.arguments import ConfigOption, EnvironmentOption, JsonOption
from cli.errors import CommandError

app = typer.Typer(help="The robot's stored maps.")

MapArgument = Annotated[str, typer.Argument(metavar="MAP", help="A map's id, or enough of its beginning or end.")]


@app.command()
def ls(*, environment: EnvironmentOption = None, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """List the stored maps of every environment, or of one."""
    from cli import client, robot
    from cli.map_store import list_maps, summary_json
    from cli.output import emit, table

    with client.connect(robot.load(config)) as bus:
        data = [summary_json(m) for m in list_maps(bus, arguments.name(environment, "--environment"))]
    columns = ("map", "environment", "time", "vertices", "length m", "MB", "generation", "parent", "finished")
    rows = [
        (
            *(m[key] for key in ("id", "environment", "time", "vertices")),
            round(m["length_m"], 1),
            round(m["bytes"] / 1e6, 1),
            m["generation"],
            m["parent"] or "",
            "yes" if m["finished"] else "no",
        )
        for m in data
    ]
    emit({"maps": data}, table("", columns, rows) if rows else "the store holds no map", as_json=as_json)


@app.command()
def show(map_id: MapArgument, *, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Show one map: its figures, its named places, and the maps that it is joined to."""
    from cli import client, robot
    from cli.map_store import details_json, find, topology
    from cli.output import emit, table

    with client.connect(robot.load(config)) as bus:
        summary = find(bus, map_id)
        data = details_json(summary, topology(bus, summary.record.environment))
    rows = [(key, _cell(value)) for key, value in data.items() if value not in (None, {})]
    emit(data, table("", ("", ""), rows), as_json=as_json)


@app.command()
def rm(
    map_id: MapArgument,
    *,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")] = False,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Remove a map from the robot, for good."""
    from cli import client, robot
    from cli.map_store import find, remove
    from cli.output import emit

    with client.connect(robot.load(config)) as bus:
        summary = find(bus, map_id)
        if not yes:
            if not sys.stdin.isatty():
                raise CommandError(
                    f"nothing was removed: give --yes, for nobody can be asked about {summary.record.id}"
                )
            question = f"remove {summary.record.id} ({summary.vertices} vertices, {summary.length:.1f} m)?"
            if not typer.confirm(question, err=True):
                raise CommandError("nothing was removed")
        answer = remove(bus, summary)
    text = answer.text or f"removed {summary.record.id}"
    emit({"removed": summary.record.id, "text": text}, text, as_json=as_json)


def _cell(value: object) -> object:
    return "\n".join(f"{key}: {item}" for key, item in value.items()) if isinstance(value, dict) else value
