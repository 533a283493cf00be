"""The fleet's page in a real browser, over the fleet's server: a person moves sliders and reads plans."""

import contextlib
import io
import json
import os
import signal

import pytest

from cli.__main__ import run
from tests.integration.browser import chromium
from tests.integration.fleet_page import DARK, LIGHT, PHONE, WIDE, FleetPage
from tests.processes import Robot, eventually, free_port
from tests.services.console.fleet import farm
from tests.services.console.fleet.serving import Serving

AT = "2026-06-13T16:20:00"
LATER = "2026-06-13T16:25:00"
WEIGHTS = ("--theta", "-1", "0.05", "0")


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """The server, with all maps of the farm but the last."""
    with Serving(tmp_path_factory.mktemp("fleet")) as fleet:
        fleet.share(farm.maps()[:-1])
        yield fleet


@pytest.fixture(scope="module")
def robot(fleet, tmp_path_factory):
    """A robot's own router, linked to the server's, its navigator and its console; the address of its page."""
    port = free_port()
    tables = f'fleet = "{fleet.router}"\n[console]\nport = {port}\n'
    with Robot(tmp_path_factory.mktemp("r1"), tables) as robot:
        robot.start("navigator")
        robot.start("console")
        yield f"http://127.0.0.1:{port}/fleet"


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


def vtr(*arguments):
    """What a command prints as JSON."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert run([*map(str, arguments), "--json"]) == 0
    return json.loads(printed.getvalue())


def pid_of(fleet, name):
    return next(row["pid"] for row in vtr("fleet", "ps", fleet.config)["processes"] if row["name"] == name)


def reads(seen, fleet, at, *weights):
    """Waits until the page shows the plan from the pond to the field that the command makes."""
    found = vtr("env", "plan", "--from", "pond", "--to", "field", "--at", at, *weights, "--config", fleet.config)
    expected = f"{found['cost']:.3f}", found["maps"]
    eventually(lambda: seen.plan() == expected, f"the page shows {expected}, and not {seen.plan()}")


def test_a_person_moves_sliders_and_reads_the_plan(fleet, browser):
    seen = FleetPage(browser, f"{fleet.page}#at={AT}").planned()
    page = seen.page
    reads(seen, fleet, AT)
    told = vtr("env", "cost", "--at", AT, "--config", fleet.config)["maps"]
    assert seen.costs() == {one["name"]: f"{one['cost']:.3f}" for one in told}
    page.locator("#hour").press("ArrowRight")
    reads(seen, fleet, LATER)
    page.get_by_role("button", name="Shortest").click()
    reads(seen, fleet, LATER, "--mode", "shortest")
    page.get_by_role("button", name="Explore").press("Enter")
    reads(seen, fleet, LATER, "--mode", "explore")
    assert page.locator("#plan-sought").is_visible()
    page.locator("#theta-1").press("ArrowRight")
    reads(seen, fleet, LATER, *WEIGHTS)
    page.get_by_label("weigh likeness").check()
    reads(seen, fleet, LATER, *WEIGHTS, "--per-metre")
    page.reload()
    reads(seen.planned(), fleet, LATER, *WEIGHTS, "--per-metre")
    page.locator('[data-place="gate"]').press("Enter")
    eventually(lambda: "→ gate" in page.locator("#plan .what").last.inner_text(), "the gate is the goal")
    page.get_by_label("Exchange start and goal").click()
    eventually(lambda: page.locator("#plan .what").first.inner_text().startswith("gate"), "the way back")
    page.locator("#to").select_option("gate")
    eventually(lambda: page.locator("#from").input_value() != "gate", "start and goal are two places")
    assert "24 h" in page.locator("#rhythms").inner_text()
    assert page.locator("#spectrum .power").count() == 1
    page.locator("#similarity canvas").press("ArrowRight")
    assert page.locator("#similarity-note").inner_text()[-5:-3] in {"0.", "1."}
    assert seen.errors == []
    assert seen.hosts == {fleet.page.split("/")[2]}


def test_a_new_map_and_a_robot_arrive_by_themselves_at_the_server_s_page_and_a_robot_s(fleet, robot, browser):
    seen, own = (FleetPage(browser, f"{address}#at={AT}").planned() for address in (fleet.page, robot))
    reads(own, fleet, AT)
    for one in (seen, own):
        eventually(lambda one=one: one.robot("r1")[:3] == ["r1", "connected", "Idle:"], "the robot is there")
        assert one.robot("r3")[1] == "away"
        assert one.maps() == "33 maps"
    fleet.share(farm.maps()[-1:])
    for one in (seen, own):
        eventually(lambda one=one: one.maps() == "34 maps", "the new map has come")
    assert seen.errors + own.errors == []


def test_it_outlives_the_server_and_the_console(fleet, browser):
    seen = FleetPage(browser, f"{fleet.page}#at={AT}").planned()
    expected = seen.plan()
    server, console = pid_of(fleet, "fleet"), pid_of(fleet, "console")
    os.kill(server, signal.SIGKILL)
    seen.says("server")
    os.kill(console, signal.SIGKILL)
    seen.page.get_by_text("reconnecting").wait_for()
    seen.page.get_by_text("live", exact=True).wait_for(timeout=30_000)
    seen.complains_no_more()
    seen.page.get_by_role("button", name="Shortest").click()
    eventually(lambda: seen.plan() != expected, "it answers again")


@pytest.mark.parametrize("address", ["environment=moon", "from=nowhere&to=a/b", "at=noon&theta=1,nan,x", "sensor=<b>"])
def test_an_address_that_makes_no_sense_shows_what_there_is(fleet, browser, address):
    seen = FleetPage(browser, f"{fleet.page}#{address}").planned()
    seen.complains_no_more()
    assert seen.page.locator("#environment").input_value() == "farm"
    assert seen.errors == []


def test_a_robot_without_a_fleet_says_so(browser, tmp_path):
    port = free_port()
    with Robot(tmp_path, f"[console]\nport = {port}\n") as robot:
        robot.start("console")
        seen = FleetPage(browser, f"http://127.0.0.1:{port}/fleet")
        seen.says("linked to no fleet")
        assert seen.page.locator("#fleet").is_hidden()


@pytest.mark.parametrize("size", [WIDE, PHONE], ids=lambda size: str(size[0]))
@pytest.mark.parametrize("scheme", [LIGHT, DARK])
def test_it_fits_the_window_and_follows_light_and_dark(robot, browser, size, scheme):
    seen = FleetPage(browser, f"{robot}#at={AT}", size, scheme).planned()
    eventually(lambda: "connected" in seen.robot("r1"), "the robot is there")
    assert seen.fits()
    assert seen.is_dark() == (scheme == DARK)
    for k in range(3):
        seen.page.locator(f"#theta-{k}").press("ArrowLeft")
    eventually(lambda: seen.page.locator("#theta-2").evaluate("one => one.value") == "-0.05", "sliders move")
    assert seen.fits()
    assert seen.errors == []
    seen.page.get_by_role("button", name="Robust").click()
    eventually(lambda: seen.page.locator("#theta-2").evaluate("one => one.value") == "0", "and back")
    seen.keep(f"console-fleet-{size[0]}-{scheme}")
