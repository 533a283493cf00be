"""``vtr up`` and ``vtr down``."""

from cli.arguments import ConfigArgument, ConfigOption, DetachOption, JsonOption


def up(
    config: ConfigArgument = None,
    *,
    named: ConfigOption = None,
    detach: DetachOption = False,
    as_json: JsonOption = False,
) -> None:
    """Start a robot's processes under the supervisor, until Ctrl-C, or in the background."""
    from cli import robot
    from cli.supervision.launch import bring_up

    bring_up(robot.find_own(config or named), detach=detach, as_json=as_json)


def down(config: ConfigArgument = None, *, named: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Stop a robot's processes and their supervisor."""
    from cli import robot
    from cli.supervision.launch import bring_down

    bring_down(robot.find_own(config or named), as_json=as_json)
