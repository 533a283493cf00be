"""``vtr fleet up``, ``down``, ``ps``, ``rebuild``."""

from pathlib import Path
from typing import Annotated

import typer

from cli.arguments import DetachOption, JsonOption

app = typer.Typer(help="The fleet's server: the storage of all maps, and what they have in common.")

_HELP = "The server's TOML file; by default ./fleet.toml."
FleetArgument = Annotated[Path | None, typer.Argument(metavar="[CONFIG]", help=_HELP)]
FleetOption = Annotated[Path | None, typer.Option("--config", "-c", help=_HELP)]


@app.command()
def up(
    config: FleetArgument = None,
    *,
    named: FleetOption = None,
    detach: DetachOption = False,
    as_json: JsonOption = False,
) -> None:
    """Start the server under the supervisor, until Ctrl-C, or in the background."""
    from cli import robot
    from cli.supervision.launch import bring_up

    bring_up(robot.find_fleet(config or named), detach=detach, as_json=as_json)


@app.command()
def down(config: FleetArgument = None, *, named: FleetOption = None, as_json: JsonOption = False) -> None:
    """Stop the server's processes and their supervisor."""
    from cli import robot
    from cli.supervision.launch import bring_down

    bring_down(robot.find_fleet(config or named), as_json=as_json)


@app.command()
def ps(config: FleetArgument = None, *, named: FleetOption = None, as_json: JsonOption = False) -> None:
    """Show the server's processes: state, pid, restarts, rates, CPU and memory."""
    from cli import robot
    from cli.commands.ps import show

    show(robot.find_fleet(config or named), as_json=as_json)


@app.command()
def rebuild(config: FleetArgument = None, *, named: FleetOption = None, as_json: JsonOption = False) -> None:
    """Make everything that the server has derived again, of what robots have stored."""
    from cli import client, robot
    from cli.output import emit
    from common import topics
    from common.messages import FleetQuery

    with client.connect(robot.load(robot.find_fleet(config or named))) as bus:
        text = bus.ask(topics.REBUILD, FleetQuery()).text
    emit({"rebuilding": True, "text": text}, text, as_json=as_json)
