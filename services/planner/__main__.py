"""Starts the planner: ``python -m services.planner --config robot.toml``."""

from common.service import run
from services.planner.service import main

if __name__ == "__main__":
    run("planner", main)
