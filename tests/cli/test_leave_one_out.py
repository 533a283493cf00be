"""The leave-one-out evaluation: Table I's averages, its pool of processes, and its command in a small world."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import psutil
import pytest

from cli.errors import CommandError
from cli.leave_one_out.pool import Pool, advance
from cli.leave_one_out.report import figures, markdown, rows, save
from cli.leave_one_out.results import BASELINE, COMBINED, EXPERIENCED, Localized, Outcome, Results
from cli.leave_one_out.study import Study, times_of_day
from services.estimator.settings import Settings
from services.sensors.world.traversal import DrivingSettings
from tests.processes import ROOT, eventually

TIMES = tuple(datetime(2026, 6, 21, hour, tzinfo=UTC) for hour in (7, 11, 17))


def localized(live, taught, baseline, combined, error=0.01, experienced=None):
    """A drive of ten frames a metre apart of which each system localizes the first few."""
    counts = {BASELINE: baseline, COMBINED: combined, EXPERIENCED: experienced}
    masks = {name: np.arange(10) < count for name, count in counts.items() if count is not None}
    outcomes = {name: Outcome(mask, np.full(10, error), np.zeros(10)) for name, mask in masks.items()}
    return Localized(live, taught, np.arange(10.0), masks[COMBINED] & ~masks[BASELINE], outcomes)


@pytest.fixture
def results():
    parts = [(0, 1, 10, 10), (0, 2, 6, 8), (1, 0, 10, 10), (1, 2, 4, 10), (2, 0, 2, 7), (2, 1, 4, 7)]
    return Results(TIMES, (20.0, 62.0, 19.0), tuple(localized(*part) for part in parts))


def test_a_row_averages_over_the_routes_that_were_taught(results):
    assert [results.coverage(drive, BASELINE) for drive in range(3)] == pytest.approx([0.8, 0.7, 0.3])
    assert [results.coverage(drive, COMBINED) for drive in range(3)] == pytest.approx([0.9, 1.0, 0.7])
    assert results.average(BASELINE) == pytest.approx(0.6)
    assert results.failure_reduction() == pytest.approx((results.average(COMBINED) - 0.6) / 0.4)
    assert results.hardest_live() == 2
    assert (results.most_helped().live, results.most_helped().taught) == (1, 2)


def test_dead_reckoning_is_over_all_drives(results):
    assert sorted(results.overall(BASELINE).dropouts) == [3.0, 5.0, 5.0, 7.0]
    assert results.overall(BASELINE).beyond(5.0) == pytest.approx(0.25)
    assert results.overall(COMBINED).beyond(5.0) == 0.0


def test_wrong_localizations_are_counted_where_the_system_believes_them(results):
    assert results.wrong(COMBINED) == 0
    off = Results(TIMES, results.elevations, (localized(0, 1, 10, 7, error=0.6),))
    assert off.wrong(COMBINED) == 7


def test_the_table_has_a_row_a_drive_and_the_pictures_are_drawn(results, tmp_path):
    report = figures(results)
    table = rows(report)
    assert [row[0] for row in table] == ["07:00", "11:00", "17:00", "average"]
    assert table[0][2:] == ["80.00 %", "90.00 %", "50 %"]
    assert table[1][4] == "100 %"
    assert markdown(report).count("\n|") == 5
    assert {path.name for path in save(results, report, tmp_path)} == {path.name for path in tmp_path.iterdir()}
    for name in ("one_vs_one.png", "one_vs_all.png", "dead_reckoning.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_experiences_have_a_column_of_their_own():
    parts = (localized(0, 1, 4, 8, experienced=10), localized(1, 0, 4, 8, experienced=9))
    report = figures(Results(TIMES[:2], (20.0, 62.0), parts))
    assert rows(report)[-1] == ["average", "", "40.00 %", "80.00 %", "67 %", "95.00 %"]
    assert "With experiences: 1 loss of" in markdown(report)


def test_times_are_spread_over_the_day():
    times = times_of_day("06:00", "18:00", 4)
    assert [f"{time:%H:%M}" for time in times] == ["06:00", "10:00", "14:00", "18:00"]
    with pytest.raises(CommandError, match="after --first"):
        times_of_day("12:00", "12:03", 8)
    with pytest.raises(CommandError, match="--last"):
        times_of_day("12:00", "noon", 8)


def test_recorded_repeats_are_neither_the_live_drive_nor_the_taught_one():
    study = Study(times_of_day("06:00", "13:00", 8), Settings(), DrivingSettings(), 1, experiences=3)
    for live in range(8):
        for taught in {*range(8)} - {live}:
            recorded = study.recorded(live, taught)
            assert len(recorded) == len({*recorded} - {live, taught}) == 3
    many = replace(study, experiences=20)
    assert many.recorded(3, 0) == [1, 2, 4, 5, 6, 7]


@pytest.mark.long
def test_two_drives_are_localized_on_each_other(vtr, tmp_path):
    out = tmp_path / "out"
    result = vtr(
        "leave-one-out", "--times", 2, "--length", 3, "--processes", 1, "--still",
        "--first", "09:00", "--last", "11:00", "--out", out, "--json",
    )  # fmt: skip
    assert result.code == 0
    report = json.loads(result.out)
    assert [drive["time"][11:16] for drive in report["drives"]] == ["09:00", "11:00"]
    assert report["average"]["combined"] == 1.0
    assert report["systems"]["combined"]["wrong_localizations"] == 0
    assert {path.name for path in out.iterdir()} == {Path(path).name for path in report["written"]}


def test_an_interrupt_leaves_nothing_behind(tmp_path):
    command = [sys.executable, "-m", "cli", "leave-one-out", "--length", "3", "--out", str(tmp_path / "out")]
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    try:
        eventually(lambda: len(psutil.Process(process.pid).children()) >= 3, "its processes are there", 60.0)
        children = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60.0)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said == "interrupted\n"
    assert not psutil.wait_procs(children, timeout=5.0)[1]
    assert not list((tmp_path / "out").iterdir())


def square(number):
    advance()
    return number * number


def fail_or_wait(number):
    if number == 0:
        raise ValueError("the first task fails")
    threading.Event().wait(60.0)
    return number


def die(number):
    if number == 1:
        os._exit(9)
    return number


def test_a_pool_shares_the_work_and_counts_it():
    seen = []
    with Pool(2, seen.append) as pool:
        assert pool.map(square, range(5)) == [0, 1, 4, 9, 16]
        assert pool.map(square, [7]) == [49]
    assert max(seen, default=0) <= 6


def test_a_failure_ends_the_other_tasks_at_once():
    start = time.monotonic()
    with pytest.raises(ValueError, match="first task"), Pool(2, lambda _: None) as pool:
        pool.map(fail_or_wait, [0, 1])
    assert time.monotonic() - start < 30.0


def test_a_killed_process_is_reported():
    with pytest.raises(CommandError, match="killed"), Pool(1, lambda _: None) as pool:
        pool.map(die, range(3))
