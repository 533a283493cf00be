"""Starts the map store: ``python -m services.mapstore --config robot.toml``."""

from common.service import run
from services.mapstore.service import main

if __name__ == "__main__":
    run("mapstore", main)
