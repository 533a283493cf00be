"""Starts the web console: ``python -m services.console --config robot.toml``."""

from common.service import run
from services.console.service import main

if __name__ == "__main__":
    run("console", main)
