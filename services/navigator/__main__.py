"""Starts the navigator: ``python -m services.navigator --config robot.toml``."""

from common.service import run
from services.navigator.service import main

if __name__ == "__main__":
    run("navigator", main)
