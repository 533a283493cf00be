"""Starts the sensors' drivers: ``python -m services.sensors --config robot.toml``."""

from common.service import run
from services.sensors.service import main

if __name__ == "__main__":
    run("sensors", main)
