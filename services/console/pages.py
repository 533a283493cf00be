"""The console's pages, in the order of the navigation: a new one is registered here."""

from __future__ import annotations

from common.service import Service
from services.console.fleet.page import FleetPage
from services.console.page import Page
from services.console.robot.page import RobotPage
from services.console.settings import Settings

ROBOT: tuple[type[Page], ...] = (RobotPage, FleetPage)
"""On a robot."""

FLEET: tuple[type[Page], ...] = (FleetPage,)
"""On the fleet's server."""


def build(service: Service, settings: Settings) -> tuple[Page, ...]:
    """The pages of a robot, or of the fleet's server; the first one is where a browser arrives."""
    kinds = FLEET if service.config.of_fleet else ROBOT
    return tuple(kind(service, settings) for kind in kinds)
