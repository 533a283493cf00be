"""``vtr pause``, ``vtr resume``, ``vtr cancel``."""

from cli.arguments import ConfigOption, JsonOption


def pause(*, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Stop the robot where it is, keeping what it was doing."""
    from cli.operator import carry_out
    from common.messages import Command

    carry_out(config, Command(action="pause"), as_json=as_json)


def resume(*, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Go on with what was paused."""
    from cli.operator import carry_out
    from common.messages import Command

    carry_out(config, Command(action="resume"), as_json=as_json)


def cancel(*, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Stop, and forget what was being done; a map being taught is finished as it stands."""
    from cli.operator import LONG_DEADLINE_S, carry_out
    from common.messages import Command

    carry_out(config, Command(action="cancel"), as_json=as_json, deadline=LONG_DEADLINE_S)
