"""Starts the storage: ``python -m services.storage --config fleet.toml``."""

from common.service import run
from services.storage.service import main

if __name__ == "__main__":
    run("storage", main)
