"""Starts the path tracker: ``python -m services.tracker --config robot.toml``."""

from common.service import run
from services.tracker.service import main

if __name__ == "__main__":
    run("tracker", main)
