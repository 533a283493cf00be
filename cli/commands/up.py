"""``vtr up`` and ``vtr down``."""

from typing import Annotated

import typer

from cli.arguments import ConfigArgument, JsonOption


def up(
    config: ConfigArgument = None,
    *,
    detach: Annotated[
        bool, typer.Option("--detach", "-d", help="Return when every process is up, and leave them running.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Start a robot's processes under the supervisor, until Ctrl-C, or in the background."""
    from cli.supervision.launch import bring_up

    bring_up(config, detach=detach, as_json=as_json)


def down(config: ConfigArgument = None, *, as_json: JsonOption = False) -> None:
    """Stop a robot's processes and their supervisor."""
    from cli.supervision.launch import bring_down

    bring_down(config, as_json=as_json)
