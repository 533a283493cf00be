"""Runs a fleet under a bad network: ``python -m bench.bad_network --robots 10 --minutes 10``, as root on Linux."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench.bad_network.inventory import contents
from bench.bad_network.judge import SYNC_S, Verdict, judge, read
from bench.bad_network.plan import Plan
from bench.bad_network.report import costs, page
from bench.bad_network.site import FLEET, Site
from services.mapstore.settings import Settings
from services.mapstore.store import Store

PAGE = Path(__file__).resolve().parents[2] / "docs" / "results" / "bad_network.md"
_SETTLE_S = 5.0
_PATIENCE_S = 2.0 * SYNC_S
_INVENTORY_S = 120.0


def main() -> None:
    """Runs, judges, and exits with 1 where something was wrong."""
    parser = argparse.ArgumentParser(prog="python -m bench.bad_network", description=__doc__)
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--delay", type=float, default=0.1, help="seconds, each way")
    parser.add_argument("--loss", type=float, default=0.05, help="share of the packets, each way")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="a folder for the logs, which are removed otherwise")
    parser.add_argument("--write", action="store_true", help=f"write {PAGE.name} into docs/results")
    options = parser.parse_args()
    plan = Plan.of(options.robots, 60.0 * options.minutes, options.delay, options.loss, options.seed)
    with contextlib.ExitStack() as stack:
        folder = options.keep or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="vtr-bad-")))
        folder.mkdir(parents=True, exist_ok=True)
        verdict, text = _run(plan, folder.absolute())
    print(text)
    if options.write:
        PAGE.parent.mkdir(exist_ok=True)
        PAGE.write_text(text, encoding="utf-8")
    sys.exit(1 if verdict.wrong else 0)


def _run(plan: Plan, folder: Path) -> tuple[Verdict, str]:
    good = dataclasses.replace(plan, loss=0.0, partitions=(), stops=())
    with Site(folder, plan) as site:
        site.begin(good)  # the wire is there for the start, and harmless; the plan takes over below
        print(f"starting {1 + len(plan.robots)} machines, logs in {folder}", flush=True)
        site.start_services()
        plan = dataclasses.replace(plan, start=time.monotonic() + _SETTLE_S)
        (folder / "plan.json").write_text(plan.text(), encoding="utf-8")
        site.begin(plan)
        site.run("agent", FLEET, "bench.bad_network.agent", str(folder))
        site.run("operator", FLEET, "bench.bad_network.operator", str(folder))
        time.sleep(_SETTLE_S)
        before = site.figures()
        time.sleep(max(plan.start + plan.seconds - time.monotonic(), 0.0))
        after = site.figures()
        _await_sync(site, plan, folder)
        (folder / "stop").touch()
        for name in ("agent", "operator"):
            site.processes[name].wait(60)
        site.run("inventory", FLEET, "bench.bad_network.inventory", str(folder))
        site.processes["inventory"].wait(_INVENTORY_S)
        carried = site.end_wire()
    server = json.loads((folder / "inventory.log").read_text(encoding="utf-8").splitlines()[-1])
    robots = {robot: _store(folder / "data" / robot / "store" / "maps.sqlite") for robot in plan.robots}
    verdict = judge(plan, read(folder / "agent.jsonl"), read(folder / "operator.jsonl"), robots, server)
    (folder / "verdict.json").write_text(json.dumps(dataclasses.asdict(verdict)), encoding="utf-8")
    return verdict, page(plan, verdict, costs(before, after, plan.seconds), carried)


def _await_sync(site: Site, plan: Plan, folder: Path) -> None:
    """Until every robot and the server say that all is shared, or nobody would wait any longer."""
    end = plan.start + plan.seconds + _PATIENCE_S
    while time.monotonic() < end:
        lines = read(folder / "agent.jsonl")
        shared = {line["robot"] for line in lines if line["kind"] == "shared"}
        finished = {line["map"] for line in lines if line["kind"] == "finished"}
        known = {line["map"] for line in read(folder / "operator.jsonl") if line["kind"] == "known"}
        if shared == set(plan.robots) and finished <= known:
            return
        for name in ("agent", "operator"):
            if site.processes[name].poll() is not None:
                raise subprocess.SubprocessError(f"the {name} ended: see {folder / name}.log")
        time.sleep(0.5)


def _store(file: Path) -> dict[str, list[int]]:
    with contextlib.closing(Store(file, Settings(reserve_mb=0))) as store:
        return contents(store)


if __name__ == "__main__":
    main()
