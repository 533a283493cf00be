"""``vtr state``."""

from typing import TYPE_CHECKING, Annotated

import typer

from cli.arguments import ConfigOption, JsonOption

if TYPE_CHECKING:
    from cli.views.state import StateView
    from cli.views.watch import Watch

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
    import contextlib

    from cli import client, robot
    from cli.output import emit, on_terminal
    from cli.processes import table_of
    from cli.views.state import StateView, lines
    from cli.views.watch import Watch

    configuration = robot.load(config)
    with client.connect(configuration) as bus:
        view = StateView(bus)
        view.wait()
        if not watch:
            data = view.json()
            emit(data, _text(lines(data)), as_json=as_json)
            return
        with contextlib.suppress(KeyboardInterrupt):
            if on_terminal() and not as_json:
                _watch(Watch(bus, view, table_of(configuration), configuration.robot.name))
            else:
                _print_changes(view, as_json=as_json)


def _watch(watch: "Watch") -> None:
    """Draws the view again and again on a screen of its own, which gives the terminal back as it was."""
    import signal
    import time

    from rich.live import Live

    from cli.output import console
    from cli.views.watch import widest

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # it gives the terminal back as well
    screen = console()
    screen.width = widest(screen.width)
    with Live(watch.picture(), console=screen, screen=True, auto_refresh=False) as live:
        while True:
            live.update(watch.picture(), refresh=True)
            time.sleep(_PERIOD_S)


def _print_changes(view: "StateView", *, as_json: bool) -> None:
    """Prints the state whenever it, or what safety says, has changed: for pipes and logs."""
    import time

    from cli.output import emit
    from cli.views.state import lines

    shown = None
    while True:
        data = view.json()
        key = ({**data["state"], "age_s": 0.0}, data["safety"])
        if key != shown:
            emit(data, _text(lines(data)) + "\n", as_json=as_json)
            shown = key
        time.sleep(_PERIOD_S)


def _text(pairs: list[tuple[str, str]]) -> str:
    return "\n".join(f"{word:13}{text}" for word, text in pairs)
