"""``vtr deploy``: the files by which an operating system starts a robot, or the fleet's server."""

from pathlib import Path
from typing import Annotated

import typer

from cli.arguments import JsonOption

app = typer.Typer(help="Files by which systemd or supervisor starts a robot, or the fleet's server, at boot.")

ConfigurationArgument = Annotated[Path, typer.Argument(metavar="CONFIG", help="A robot's TOML file, or the server's.")]


@app.command()
def systemd(
    config: ConfigurationArgument,
    *,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where the units are written.")],
    user: Annotated[str, typer.Option("--user", help="Who runs the processes.")] = "retraverse",
    python: Annotated[
        Path | None, typer.Option("--python", help="The interpreter that the units name; by default this one.")
    ] = None,
    configuration: Annotated[
        Path | None,
        typer.Option("--configuration", metavar="PATH", help="Where the units find CONFIG; by default where it is."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a template unit, its limits for each process, and a target."""
    import sys

    from cli import robot
    from cli.deployment.systemd import Installation, units
    from cli.output import emit
    from cli.processes import OPTIONAL, table_of

    loaded = robot.load(config)
    robot.check(loaded)
    table = table_of(loaded)
    more = () if loaded.of_fleet else tuple(process for process in OPTIONAL if process not in table)
    at = Installation(python or Path(sys.executable), configuration or config.absolute(), user)
    files = units(loaded, table, more, at)
    _write(output, files)
    target = f"retraverse-{'fleet' if loaded.of_fleet else 'robot'}.target"
    text = f"{len(files)} files in {output}; then: systemctl daemon-reload && systemctl enable --now {target}"
    emit({"files": sorted(str(output / name) for name in files)}, text, as_json=as_json)


@app.command()
def supervisor(
    config: ConfigurationArgument,
    *,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Written there instead of printed.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Print the supervisor's configuration, as vtr up makes it, for a supervisord that the machine starts."""
    from cli import robot
    from cli.output import emit
    from cli.processes import table_of
    from cli.supervision.files import SupervisorFiles, environment_of, render

    loaded = robot.load(config)
    robot.check(loaded)
    files = SupervisorFiles.of(loaded)
    text = render(files, table_of(loaded), environment_of(loaded))
    files.make()
    if output is not None:
        _write(output.parent, {output.name: text})
        emit({"files": [str(output)]}, f"written to {output}", as_json=as_json)
    elif as_json:
        emit({"text": text}, "", as_json=True)
    else:
        typer.echo(text, nl=False)


def _write(folder: Path, files: dict[str, str]) -> None:
    """Writes files below a folder.

    Raises:
        CommandError: they cannot be written.
    """
    from cli.errors import CommandError

    for name, text in files.items():
        path = folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise CommandError(f"cannot write {path}: {error.strerror}") from None
