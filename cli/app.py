"""The command ``vtr``: every command, in the order and groups of its help."""

from collections.abc import Callable
from typing import Annotated

import typer

from cli.commands import (
    align,
    calibrate,
    doctor,
    env,
    estop,
    localize,
    maps,
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

PROCESSES, OPERATION, DATA = "A robot's processes", "An operator's commands", "Maps and recordings"

COMMANDS: tuple[tuple[str, tuple[Callable[..., None], ...]], ...] = (
    (PROCESSES, (demo, up.up, up.down, ps.ps, doctor.doctor, calibrate.calibrate)),
    (
        OPERATION,
        (
            teach.teach,
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

app = typer.Typer(
    name="vtr",
    help="Retraverse: drive a route once, and the robot drives it again by sight.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for panel, commands in COMMANDS:
    for command in commands:
        app.command(rich_help_panel=panel)(command)
app.add_typer(maps.app, name="maps", rich_help_panel=DATA)
app.add_typer(env.app, name="env", rich_help_panel=DATA)


@app.callback(invoke_without_command=True)
def vtr(
    context: typer.Context,
    *,
    debug: Annotated[  # noqa: ARG001, cli/__main__.py looks for it in the arguments, whatever fails
        bool, typer.Option("--debug", help="Show the traceback of an unexpected error.")
    ] = False,
) -> None:
    """Retraverse: drive a route once, and the robot drives it again by sight."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
