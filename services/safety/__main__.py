"""Starts the safety monitor: ``python -m services.safety --config robot.toml``."""

from common.service import run
from services.safety.service import main

if __name__ == "__main__":
    run("safety", main)
