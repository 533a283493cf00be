"""An operator's day at the web console: a browser, and a robot of real processes."""

import os
from pathlib import Path

import pytest

from cli.processes import ROBOT
from common import topics
from tests.integration.browser import RobotPage, chromium
from tests.integration.whole_robot import state_is
from tests.processes import Robot, free_port

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"
TAUGHT_M = 9.0
MERGED_M = 3.0
MATCHED = 30
SEEN_MS = 1500


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Where the screenshots go: into the docs where VTR_SCREENSHOTS is set, as ``make docs`` may."""
    return IMAGES if os.environ.get("VTR_SCREENSHOTS") else tmp_path_factory.mktemp("screenshots")


def teach(robot, page):
    """By the page's joystick, then by a human who knows the way; letting go stops the robot."""
    page.press("teach")
    page.answer(start_place="home")
    page.state("Teach · Branch")
    page.hold("ArrowUp", lambda: robot.soon(lambda: robot.speed() > 0.3, "the joystick drives"))
    robot.soon(lambda: robot.speed() < 0.02, "a joystick that is let go stops the robot", 3.0)
    human = robot.drive_by_hand(robot.first_metres(TAUGHT_M))
    assert human.arrived.wait(60)
    robot.soon(lambda: robot.speed() < 0.01, "the robot stands")
    human.stop()
    page.press("finish")
    page.answer(end_place="gate")
    page.state("Idle")
    (map_id,) = robot.taught()
    page.page.wait_for_function(
        "([map, count]) => globalThis.vtrMap.graph.size(map) === count", arg=[map_id, robot.vertices()[map_id]]
    )
    return map_id


def name_and_limit(page, map_id, last):
    """A place is named, and a stretch limited, by clicks on the map."""
    page.page.click("#map-fit")
    page.choose(map_id, last // 2, "Name this place")
    page.answer(place="bend")
    page.page.wait_for_function("() => globalThis.vtrMap.graph.places.bend !== undefined")
    page.choose(map_id, last // 2 + 1, "Mark a stretch")
    page.choose(map_id, last - 2)
    page.answer(speed="0.5", reason="wet leaves")
    page.page.wait_for_function("() => globalThis.vtrMap.graph.restrictions.length === 1")


def drive(robot, page, map_id, last):
    """To a clicked goal, with a pause and an emergency stop on the way."""
    robot.put_down(*robot.route[0])
    page.choose(map_id, 0, "The robot is here")
    page.choose(map_id, last, "Drive here")
    page.state("Repeat · Follow")
    assert "finish or cancel" in page.why_not("teach")
    robot.soon(lambda: robot.speed() > 0.3, "the robot drives")
    page.press("pause")
    page.state("Paused")
    robot.soon(lambda: robot.speed() < 0.02, "it stands")
    page.press("resume")
    page.state("Repeat · Follow")
    robot.soon(lambda: robot.speed() > 0.3, "it drives on")
    page.page.keyboard.press("Escape")
    robot.soon(lambda: robot.speed() < 0.02, "Stop stops it", 3.0)
    page.state("Paused")
    assert "emergency stop" in page.page.inner_text("#safety")
    page.page.click("#reset")
    page.press("resume")
    page.state("Repeat · Follow")
    page.page.wait_for_function("metres => globalThis.vtrLink.values.get('live').remaining < metres", arg=TAUGHT_M - 3)


def agrees(robot, page):
    """What the page shows is what the bus says."""
    states, located = robot.states(), robot.bus.subscribe(topics.LOCALIZATION)
    found = robot.soon(located.last, "a localization arrives").message
    name = robot.soon(states.last, "a state arrives").message.name.value
    page.page.wait_for_function("name => globalThis.vtrLink.values.get('state').name === name", arg=name)
    page.page.wait_for_function(
        "stamp => globalThis.vtrLink.values.get('live').stamp >= stamp && document.querySelector('#figures dd')",
        arg=found.stamp,
    )
    live = page.section("live")
    assert abs(live["lateral"]) < 0.5
    assert live["streams"].keys() == found.streams.keys()
    page.page.wait_for_function(
        "count => Number(document.getElementById('camera').dataset.features) > count", arg=MATCHED
    )


def merge(robot, page, map_id):
    """A map that is taught over the first one meets it, once the operator agrees."""
    robot.put_down(*robot.route[0])
    page.choose(map_id, 0, "The robot is here")
    page.press("teach")
    page.answer()
    page.state("Teach · Branch")
    human = robot.drive_by_hand(robot.first_metres(MERGED_M))
    assert human.arrived.wait(60)
    page.press("merge")
    page.press("confirm")
    human.stop()
    page.answer(end_place="crossing")
    page.state("Idle")
    assert len(robot.taught()) == 2
    page.page.wait_for_function("() => globalThis.vtrMap.graph.joints.length > 0")


def kill_and_see(robot, page, process):
    """A killed process is seen to be gone, and to be back."""
    _, pid = robot.kill(process)
    page.wait_process(process, gone=True, deadline_ms=SEEN_MS)
    robot.wait_back(process, pid)
    page.wait_process(process, gone=False, deadline_ms=SEEN_MS)


def test_an_operators_day(robot, browser, pictures):
    robot.calm()
    robot.put_down(*robot.route[0])
    robot.forget_maps()
    port = robot.supervised.config.tables["console"]["port"]
    page = RobotPage(browser, f"http://127.0.0.1:{port}/")
    page.state("Idle")
    page.page.wait_for_function("() => document.getElementById('do-repeat').title.includes('teach one')")
    map_id = teach(robot, page)
    last = robot.vertices()[map_id] - 1
    name_and_limit(page, map_id, last)
    drive(robot, page, map_id, last)
    agrees(robot, page)
    page.pictures(pictures, "robot")
    states = robot.states()
    robot.kill("console")
    page.is_away()
    robot.soon(lambda: state_is(states, "Idle"), "the robot goes on without its console", 60.0)
    assert states.last().message.reason.startswith("reached")
    page.is_live()
    page.state("Idle")
    kill_and_see(robot, page, "planner")
    merge(robot, page, map_id)
    page.page.wait_for_function("() => document.getElementById('timeline').textContent.includes('reached')")
    assert page.errors == []
    hosts = {url.split("/")[2] for url in page.requests if not url.startswith("blob:")}
    assert hosts == {f"127.0.0.1:{port}"}


@pytest.fixture(scope="module")
def watched(robot, browser):
    """A page that is open while processes are killed."""
    robot.calm()
    return RobotPage(browser, f"http://127.0.0.1:{robot.supervised.config.tables['console']['port']}/")


@pytest.mark.long
@pytest.mark.parametrize("process", [process.name for process in ROBOT if process.name != "console"])
def test_each_process_is_seen_to_be_gone_and_to_be_back(robot, watched, process):
    watched.is_live()
    kill_and_see(robot, watched, process)
    assert watched.errors == []


def test_a_person_gives_the_token_once(browser, tmp_path):
    port, token = free_port(), tmp_path / "token"
    token.write_text("0123456789abcdef0123")
    token.chmod(0o600)
    table = f'[console]\nhost = "0.0.0.0"\nport = {port}\ntoken_file = "token"\n'
    with Robot(tmp_path, table) as alone:
        alone.start("console")
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{port}/", wait_until="load")
        page.fill("[name=token]", "0123456789abcdef9999")
        page.click("button[type=submit]")
        page.wait_for_selector("[role=alert]")
        page.wait_for_timeout(600)
        page.fill("[name=token]", token.read_text())
        page.click("button[type=submit]")
        page.wait_for_function("() => document.getElementById('link')?.textContent === 'live'")
        page.wait_for_function("() => document.getElementById('do-teach').title.includes('navigator is not running')")
        page.goto(f"http://127.0.0.1:{port}/")
        page.wait_for_function("() => document.getElementById('link')?.textContent === 'live'")
