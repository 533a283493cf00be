"""The command ``vtr``: every command, in the order and groups of its help."""

import functools
from collections.abc import Callable
from importlib import metadata
from typing import Annotated, Any

import typer

from cli.chaos.command import chaos
from cli.commands import (
    align,
    calibrate,
    deploy,
    doctor,
    drive,
    env,
    estop,
    fleet,
    keys,
    localize,
    maps,
    merge,
    mission,
    odometry,
    play,
    position,
    ps,
    record,
    repeat,
    replay_diff,
    state,
    teach,
    up,
)
from cli.demo.command import demo
from cli.leave_one_out.command import leave_one_out
from cli.soak.command import soak

PROCESSES, OPERATION, DATA = "A robot's processes", "An operator's commands", "Maps and recordings"

COMMANDS: tuple[tuple[str, tuple[Callable[..., None], ...]], ...] = (
    (PROCESSES, (demo, up.up, up.down, ps.ps, doctor.doctor, chaos, soak)),
    (
        OPERATION,
        (
            teach.teach,
            drive.drive,
            merge.merge,
            repeat.repeat,
            mission.pause,
            mission.resume,
            mission.cancel,
            estop.estop,
            position.position,
            state.state,
        ),
    ),
    (
        DATA,
        (
            play.play,
            record.record,
            replay_diff.replay_diff,
            odometry.odometry,
            localize.localize,
            align.align,
            leave_one_out,
        ),
    ),
)

HELP = ["-h", "--help"]

app = typer.Typer(
    name="vtr",
    help="Retraverse: drive a route once, and the robot drives it again by sight.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": HELP},
)
for panel, commands in COMMANDS:
    for command in commands:
        app.command(rich_help_panel=panel)(command)
app.add_typer(calibrate.app, name="calibrate", rich_help_panel=PROCESSES)
app.add_typer(maps.app, name="maps", rich_help_panel=DATA)
app.add_typer(fleet.app, name="fleet", rich_help_panel=PROCESSES)
app.add_typer(keys.app, name="keys", rich_help_panel=PROCESSES)
app.add_typer(deploy.app, name="deploy", rich_help_panel=PROCESSES)
app.add_typer(env.app, name="env", rich_help_panel=DATA)


@functools.cache
def command_line() -> Any:  # noqa: ANN401, Typer's own group of commands
    """The tree of all commands, as the help, the shells' completion and the documentation read it."""
    made = typer.main.get_command(app)
    _tidy(made)
    return made


def _tidy(command: Any) -> None:  # noqa: ANN401, Typer's own command
    """A flag takes no value, so its help names no type of one."""
    help_option = command.get_help_option(typer.Context(command, help_option_names=HELP))
    for parameter in (*command.params, help_option):
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
    for inner in getattr(command, "commands", {}).values():
        _tidy(inner)


def _version(wanted: bool) -> None:  # noqa: FBT001, Typer's callback
    if wanted:
        typer.echo(f"vtr {metadata.version('retraverse')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def vtr(
    context: typer.Context,
    *,
    version: Annotated[  # noqa: ARG001, its callback has done it
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
    debug: Annotated[  # noqa: ARG001, cli/__main__.py looks for it in the arguments, whatever fails
        bool, typer.Option("--debug", help="Show the traceback of an unexpected error.")
    ] = False,
) -> None:
    """Retraverse: drive a route once, and the robot drives it again by sight."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
