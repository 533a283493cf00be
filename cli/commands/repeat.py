"""``vtr repeat``."""

from typing import TYPE_CHECKING, Annotated, Literal

import typer

from cli import arguments, completion
from cli.arguments import ConfigOption, EnvironmentOption, FromOption, JsonOption
from cli.errors import CommandError

if TYPE_CHECKING:
    from common.bus import Bus
    from common.messages import Command, Done


def repeat(
    goals: Annotated[
        list[str],
        typer.Argument(
            metavar="GOAL...",
            help="Named places, maps' ids (their ends), or vertices as map:index.",
            autocompletion=completion.places,
        ),
    ],
    *,
    vertex: FromOption = None,
    place: Annotated[
        str | None,
        typer.Option(
            "--from-place",
            metavar="PLACE",
            help="The place that it stands at, where it has no map yet.",
            autocompletion=completion.places,
        ),
    ] = None,
    append: Annotated[
        bool, typer.Option("--append", help="Put them behind the goals that the robot drives to already.")
    ] = False,
    swap: Annotated[
        bool, typer.Option("--swap", help="Put them in place of the goal that the robot drives to now.")
    ] = False,
    rest_before: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="Seconds that it rests before it sets out for each goal.")
    ] = 0.0,
    rest_after: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="Seconds that it rests at each goal before it goes on.")
    ] = 0.0,
    mode: Annotated[
        str | None,
        typer.Option(
            metavar="MODE",
            help="How maps are chosen: robust, shortest, or explore, which records as well.",
            autocompletion=completion.modes,
        ),
    ] = None,
    theta: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="SIMILARITY DISTANCE DRIFT", help="The weights themselves; negative to explore."),
    ] = None,
    record: Annotated[
        bool | None,
        typer.Option(
            "--record/--no-record", help="Record an experience on the way; by default as the robot is configured."
        ),
    ] = None,
    wait: Annotated[
        bool, typer.Option("--wait", help="Return when the robot is at the last goal, or say why not.")
    ] = False,
    environment: EnvironmentOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Drive to a goal over taught maps, by sight; with several, to one after another."""
    from cli import client, robot
    from cli.operator import report
    from cli.waiting import RepeatWatch
    from common.environment.costs import MODES
    from common.messages import Command, Goal

    if vertex is not None and place is not None:
        raise CommandError("--from and --from-place both say where the robot stands: give one")
    if append and swap:
        raise CommandError("--append and --swap both say what becomes of the present goal: give one")
    if (append or swap) and (vertex is not None or place is not None):
        raise CommandError("the robot is driving: --from and --from-place belong to the beginning of a repeat")
    if mode is not None and theta is not None:
        raise CommandError("--mode names weights and --theta gives them: give one")
    if mode not in {None, *MODES}:
        raise CommandError(f"'{mode}' is no mode: take one of {', '.join(MODES)}")

    def goal(text: str) -> Goal:
        return Goal(
            to=text,
            pause_before=rest_before,
            pause_after=rest_after,
            mode=mode,  # type: ignore[arg-type]  # checked above
            theta=theta,
            record=record,
        )

    first: Literal["append", "swap", "repeat"] = "append" if append else "swap" if swap else "repeat"
    command = Command(
        action=first,
        goal=goal(goals[0]),
        start_place=arguments.place(place, "--from-place"),
        environment=arguments.name(environment, "--environment"),
        vertex=arguments.vertex_id(vertex, "--from"),
    )
    others = [Command(action="append", goal=goal(text)) for text in goals[1:]]
    with client.connect(robot.load(config)) as bus:
        watch = RepeatWatch(bus)
        answer = _ordered(bus, command, others)
        if wait:
            try:
                answer = watch.until_done()
            except KeyboardInterrupt:
                raise CommandError("no longer waiting, and the robot drives on: vtr pause stops it") from None
        report(answer, command, as_json=as_json)


def _ordered(bus: "Bus", command: "Command", others: "list[Command]") -> "Done":
    """Gives the order for the first goal, and has the others wait behind it."""
    from cli.operator import LONG_DEADLINE_S, order
    from common.messages import Done

    texts = [order(bus, one, LONG_DEADLINE_S).text for one in (command, *others)]
    return Done(text="\n".join(texts)[:2000])
