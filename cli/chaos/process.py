"""Runs a service with faults that can be switched on from outside: ``python -m cli.chaos.process services.tracker``."""

from __future__ import annotations

import os
import runpy
import sys
from pathlib import Path

from cli.chaos import orders
from cli.chaos.injection import Injector
from common import config


def main() -> None:
    """Listens for orders in a thread, and is the service otherwise."""
    module = sys.argv.pop(1)
    configuration = config.load(Path(os.environ["VTR_CONFIG"]))
    injector = Injector()
    injector.install()
    orders.listen(orders.socket_of(configuration, module.rpartition(".")[2]), injector.obey)
    sys.argv[0] = module
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
