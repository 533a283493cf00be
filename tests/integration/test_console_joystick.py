"""The page's joystick lets go by itself, whatever happens to the page that holds it."""

import time

import pytest

from common import topics
from common.messages import State, StateName, now_ns
from tests.integration.browser import RobotPage, chromium
from tests.processes import Robot, eventually, every, free_port
from tests.services.console.acting import ActedRobot, network

SILENT_S = 0.4
HIDDEN = """() => {
    Object.defineProperty(document, "hidden", { configurable: true, get: () => true });
    document.dispatchEvent(new Event("visibilitychange"));
}"""


class Scene:
    """A robot that is taught, its console, a page, and what is heard on ``command/teleop``."""

    def __init__(self, url, browser, heard):
        self.url, self.browser, self.heard = url, browser, heard
        self.page = None

    def hold(self):
        """A page whose joystick is held; one that an earlier test has spoilt is replaced."""
        if self.page is None or self.page.page.is_closed():
            self.page = RobotPage(self.browser, self.url)
        page = self.page.page
        page.keyboard.up("ArrowUp")
        page.wait_for_function("() => document.getElementById('teleop-state').textContent === 'ready'")
        page.focus("#pad")
        page.keyboard.down("ArrowUp")
        return page

    def count(self):
        """Commands that have come since the last call."""
        return sum(1 for _ in iter(self.heard.take, None))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    port = free_port()
    with Robot(tmp_path_factory.mktemp("joystick"), f"[console]\nport = {port}\n") as robot, chromium() as browser:
        acted = ActedRobot(robot, *network(20, 0))
        acted.state = State(stamp=1, name=StateName.TEACH_BRANCH, environment="default", since=now_ns(), reason="")
        with every(0.1, acted.tick):
            robot.start("console")
            yield Scene(f"http://127.0.0.1:{port}/", browser, robot.bus("watcher").tap([(topics.TELEOP, "")]))


LETTING_GO = {
    "the key comes up": lambda page: page.keyboard.up("ArrowUp"),
    "the window loses the focus": lambda page: page.evaluate("() => window.dispatchEvent(new Event('blur'))"),
    "the pad loses the focus": lambda page: page.focus("#goal"),
    "the connection ends": lambda page: page.evaluate("() => globalThis.vtrLink.socket.close()"),
    "the page is closed": lambda page: page.close(),
    "the tab is hidden": lambda page: page.evaluate(HIDDEN),
}


@pytest.mark.parametrize("letting_go", LETTING_GO)
def test_it_lets_go_when(scene, letting_go):
    page = scene.hold()
    commands = 0
    while commands < 3:
        commands += eventually(scene.count, "commands come")
    LETTING_GO[letting_go](page)
    time.sleep(SILENT_S)
    scene.count()
    time.sleep(SILENT_S)
    assert scene.count() == 0
