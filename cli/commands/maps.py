"""``vtr maps ls``, ``show``, ``rm``, ``block``, ``limit``, ``free``, ``export``, ``import``, ``push``, ``pull``."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from cli import arguments, completion
from cli.arguments import ConfigOption, EnvironmentOption, JsonOption
from cli.errors import CommandError

app = typer.Typer(help="The robot's stored maps.")

MapArgument = Annotated[
    str,
    typer.Argument(
        metavar="MAP", help="A map's id, or enough of its beginning or end.", autocompletion=completion.maps
    ),
]


@app.command()
def ls(
    *,
    fleet: Annotated[bool, typer.Option("--fleet", help="Those that the fleet shares.")] = False,
    environment: EnvironmentOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """List the stored maps of every environment, or of one."""
    from cli import client, robot
    from cli.map_store import list_maps, summary_json
    from cli.output import emit, table

    if fleet:
        _list_shared(environment, config, as_json=as_json)
        return
    with client.connect(robot.load(config)) as bus:
        data = [summary_json(m) for m in list_maps(bus, arguments.name(environment, "--environment"))]
    columns = (
        "map",
        "environment",
        "from",
        "to",
        "time",
        "vertices",
        "length m",
        "MB",
        "generation",
        "parent",
        "shared",
    )
    rows = [
        (
            *(m[key] for key in ("id", "environment", "start_place", "end_place", "time", "vertices")),
            round(m["length_m"], 1),
            round(m["bytes"] / 1e6, 1),
            m["generation"],
            m["parent"] or "",
            m["sync"].lower() if m["finished"] else "in the making",
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


StretchArgument = Annotated[
    str,
    typer.Argument(
        metavar="STRETCH",
        help="A map, or a part of it: MAP, MAP:INDEX or MAP:FIRST-LAST.",
        autocompletion=completion.maps,
    ),
]
ReasonOption = Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why, for whoever wonders.")]


@app.command()
def block(
    stretch: StretchArgument,
    *,
    reason: ReasonOption = "",
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Have the robot drive over a stretch no more; a repeat that leads there is planned anew at once."""
    _restrict(config, stretch, 0.0, reason, as_json=as_json)


@app.command()
def limit(
    stretch: StretchArgument,
    speed: Annotated[float, typer.Argument(metavar="SPEED", min=0.01, help="Metres a second.")],
    *,
    reason: ReasonOption = "",
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Have the robot drive no faster on a stretch."""
    _restrict(config, stretch, speed, reason, as_json=as_json)


@app.command()
def free(stretch: StretchArgument, *, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Lift what is blocked or limited on a stretch."""
    _restrict(config, stretch, None, "", as_json=as_json)


@app.command()
def export(
    map_id: MapArgument,
    *,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE.zip", help="By default MAP.zip.")
    ] = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write a finished map to a file, on the robot's own machine; whether the robot runs does not matter."""
    from cli import map_files, robot
    from cli.output import emit

    done = map_files.export(robot.load(config), map_id, output)
    emit(done.json(), f"{done.map}: {done.bytes / 1e6:.1f} MB in {done.file}", as_json=as_json)


@app.command(name="import")
def import_(
    files: Annotated[list[Path], typer.Argument(metavar="FILE.zip...", help="Maps that were exported, or fetched.")],
    *,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Bring maps from files into the robot's store, each once all of it was verified."""
    from cli import map_files, robot
    from cli.output import emit, progress

    with progress() as bar:
        done = map_files.import_all(robot.load(config), files, bar)
    text = "\n".join(f"{one.map}: {one.vertices} vertices, from {one.file}" for one in done)
    emit({"maps": [one.json() for one in done]}, text, as_json=as_json)


@app.command()
def push(
    map_ids: Annotated[
        list[str] | None,
        typer.Argument(metavar="[MAP...]", help="By default all.", autocompletion=completion.maps),
    ] = None,
    *,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Share finished maps with the fleet now, and wait until they are."""
    from cli import client, robot, sharing
    from cli.map_store import find
    from cli.output import emit, progress

    with client.connect(robot.load(config)) as bus, progress() as bar:
        named = [find(bus, text).record.id for text in map_ids or []]
        done = sharing.push(bus, named, bar)
    emit({"maps": [one.model_dump(mode="json") for one in done]}, sharing.text(done), as_json=as_json)


@app.command()
def pull(
    map_ids: Annotated[list[str] | None, typer.Argument(metavar="[MAP...]", help="Whole ids of shared maps.")] = None,
    *,
    every: Annotated[bool, typer.Option("--all", help="Every map of the environment.")] = False,
    environment: EnvironmentOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fetch maps that the fleet shares, and wait until they are here."""
    from cli import client, robot, sharing
    from cli.environment_source import catalog
    from cli.output import emit, progress

    configuration = robot.load(config)
    chosen = arguments.name(environment, "--environment") or configuration.robot.environment
    if every == bool(map_ids):
        raise CommandError("name the maps to fetch, or give --all; vtr maps ls --fleet lists them")
    with client.connect(configuration) as bus, progress() as bar:
        wanted = [entry.map for entry in catalog(bus, chosen)] if every else arguments.map_ids(map_ids or [])
        done = sharing.pull(bus, chosen, wanted, bar)
    emit({"maps": [one.model_dump(mode="json") for one in done]}, sharing.text(done), as_json=as_json)


def _restrict(config: Path | None, text: str, speed: float | None, reason: str, *, as_json: bool) -> None:
    from cli import client, robot
    from cli.map_store import stretch
    from cli.operator import LONG_DEADLINE_S, order, report
    from common.messages import Command

    with client.connect(robot.load(config)) as bus:
        restriction = stretch(bus, text).model_copy(update={"speed": speed, "reason": reason[:2000]})
        command = Command(action="restrict", restriction=restriction)
        report(order(bus, command, LONG_DEADLINE_S), command, as_json=as_json)


def _list_shared(environment: str | None, config: Path | None, *, as_json: bool) -> None:
    """Shows the maps that the fleet shares."""
    from cli.environment_source import of_fleet
    from cli.output import emit, table
    from common.environment.model import environment_json

    known = of_fleet(environment, config)
    rows = [
        (
            one.name,
            one.start,
            one.end,
            one.timestamp.isoformat(timespec="seconds"),
            round(one.length, 1),
            one.generation,
        )
        for one in known.maps
    ]
    text = table(f"environment '{known.name}'", ("map", "from", "to", "time", "length m", "generation"), rows)
    emit(environment_json(known), text if rows else f"environment '{known.name}' has no maps", as_json=as_json)


def _cell(value: object) -> object:
    return "\n".join(f"{key}: {item}" for key, item in value.items()) if isinstance(value, dict) else value
