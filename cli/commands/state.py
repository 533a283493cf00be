"""``vtr state``."""

from typing import TYPE_CHECKING, Annotated

import typer

from cli.arguments import ConfigOption, JsonOption

if TYPE_CHECKING:
    from cli.views.state import StateView

_PERIOD_S = 0.2


def state(
    *,
    watch: Annotated[
        bool, typer.Option("--watch", "-w", help="Keep showing it until Ctrl-C; with --json, a line at each change.")
    ] = False,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show what the robot does, why, what it waits for, and whether safety lets it move."""
    from cli import client, robot
    from cli.output import emit
    from cli.views.state import StateView, lines

    with client.connect(robot.load(config)) as bus:
        view = StateView(bus)
        view.wait()
        if watch:
            _watch(view, as_json=as_json)
        else:
            data = view.json()
            emit(data, "\n".join(f"{word:13}{text}" for word, text in lines(data)), as_json=as_json)


def _watch(view: "StateView", *, as_json: bool) -> None:
    import contextlib

    with contextlib.suppress(KeyboardInterrupt):
        if as_json:
            _watch_json(view)
        else:
            _watch_text(view)


def _watch_text(view: "StateView") -> None:
    import time

    from rich.live import Live
    from rich.text import Text

    from cli.output import console
    from cli.views.state import lines

    with Live(console=console(), refresh_per_second=1 / _PERIOD_S) as live:
        while True:
            live.update(Text("\n".join(f"{word:13}{text}" for word, text in lines(view.json()))))
            time.sleep(_PERIOD_S)


def _watch_json(view: "StateView") -> None:
    import time

    from cli.output import emit

    shown = None
    while True:
        data = view.json()
        key = ({**data["state"], "age_s": 0.0}, data["safety"])
        if key != shown:
            emit(data, "", as_json=True)
            shown = key
        time.sleep(_PERIOD_S)
