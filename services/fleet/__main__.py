"""Starts the fleet's server: ``python -m services.fleet --config fleet.toml``."""

from common.service import run
from services.fleet.service import main

if __name__ == "__main__":
    run("fleet", main)
