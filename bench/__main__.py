"""Runs the measurements: ``python -m bench`` all of them, ``python -m bench se3`` one, each printing its tables."""

from __future__ import annotations

import argparse
import importlib
import pkgutil
from pathlib import Path

_NOT_A_BENCH = frozenset({"__main__", "bad_network", "followers", "recordings", "table"})
"""Helpers, and what needs root and ten minutes: ``python -m bench.bad_network``."""


def names() -> list[str]:
    """The benches: the modules of this folder."""
    found = (module.name for module in pkgutil.iter_modules([str(Path(__file__).parent)]))
    return sorted(name for name in found if name not in _NOT_A_BENCH and not name.startswith("_"))


def main() -> None:
    """Runs the benches that are named on the command line, or all."""
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("name", nargs="*", help=f"of {', '.join(names())}; all when none is named")
    chosen = parser.parse_args().name or names()
    for name in chosen:
        if name not in names():
            parser.error(f"there is no bench '{name}': choose of {', '.join(names())}")
    for name in chosen:
        importlib.import_module(f"bench.{name}").main()


if __name__ == "__main__":
    main()
