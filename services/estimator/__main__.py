"""Starts the estimator: ``python -m services.estimator --config robot.toml``."""

from common.service import run
from services.estimator.service import main

if __name__ == "__main__":
    run("estimator", main)
