"""Whether the robot's web page can be served."""

from __future__ import annotations

from cli import robot
from cli.doctor.check import Check
from cli.supervision import endpoints
from common.config import RobotConfig
from common.errors import ConfigurationError

_OTHER_PAGE = "set another host or port in [console]"


def check_page(configuration: RobotConfig) -> Check:
    """Whether the web page's port is free or, where the robot is up, answered by its console."""
    address = robot.page_address(configuration)
    try:
        page = endpoints.parse(f"tcp/{address.partition('://')[2]}")
        up = endpoints.parse(configuration.bus.endpoint).answers(1.0)
        if not page.answers(1.0):
            page.check_free()
            state = "nobody serves it yet" if up else "the port is free"
            return Check("page", "warn" if up else "ok", f"{address}: {state}", "see vtr ps" if up else "")
    except ConfigurationError:
        return Check("page", "fail", f"the page cannot be served at {address}", _OTHER_PAGE)
    if up:
        return Check("page", "ok", f"{address} answers")
    return Check("page", "fail", f"{address} is used by another program", _OTHER_PAGE)
