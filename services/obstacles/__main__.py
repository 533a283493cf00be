"""Starts the obstacle watch: ``python -m services.obstacles --config robot.toml``."""

from common.service import run
from services.obstacles.service import main

if __name__ == "__main__":
    run("obstacles", main)
