"""Starts the robot's router: ``python -m services.router --config robot.toml``."""

from common.service import run
from services.router.service import main

if __name__ == "__main__":
    run("router", main, mode="router")
