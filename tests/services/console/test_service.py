"""The console as its own process, by HTTP and WebSocket, beside the acted processes of a robot."""

import asyncio
import contextlib
import json
import socket
import urllib.error
import urllib.parse
import urllib.request

import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

from common import topics
from common.messages import State, StateName, now_ns
from tests.processes import Robot, eventually, every, free_port
from tests.services.console.acting import ActedRobot, network

TOKEN = "0123456789abcdef0123"  # noqa: S105, of this test alone


class Console:
    """A console that is served, and a browser without a window.

    It is that of an acted robot; ``beside`` another one, of a robot without any other process, and locked by a token.
    """

    def __init__(self, folder, stack, beside=None):
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        table = f"[console]\nport = {self.port}\nimage_rate = 10.0\n"
        if beside is not None:
            file = folder / "token"
            file.write_text(TOKEN)
            file.chmod(0o600)
            table += 'token_file = "token"\norigins = ["https://ops.example"]\n'
        if beside is None:
            self.robot = stack.enter_context(Robot(folder, table))
            self.acted = ActedRobot(self.robot, *network(40, 1))
            self.acted.publish_route()
            stack.enter_context(every(0.1, lambda: self.acted.tick(frames=True)))
        else:
            self.robot = stack.enter_context(Robot(folder, table, "r2", beside.robot))
        self.start()

    def start(self):
        self.robot.start("console")
        eventually(lambda: self.status("/login") == 200, "the page is served")

    def request(self, path, *, body=None, **headers):
        """Status, headers and text of an answer; redirections are not followed."""
        request = urllib.request.Request(self.url + path, data=body, headers=headers)  # noqa: S310
        opener = urllib.request.build_opener(_Stay)
        try:
            with opener.open(request, timeout=10) as answer:
                return answer.status, answer.headers, answer.read().decode(errors="replace")
        except urllib.error.HTTPError as error:
            return error.code, error.headers, error.read().decode(errors="replace")

    def status(self, path, **options):
        with contextlib.suppress(OSError):
            return self.request(path, **options)[0]
        return None

    def do(self, action, page="robot", **arguments):
        """Whether an action is done, and what is told of it."""
        status, _, text = self.request(f"/do/{page}/{action}", body=json.dumps(arguments).encode())
        return status == 200, json.loads(text)["told"]

    def log(self):
        return self.robot.log("console")

    def browse(self, story, **headers):
        """Runs a story with an open page."""

        async def run():
            request = HTTPRequest(f"ws://127.0.0.1:{self.port}/ws/robot", headers=headers)
            socket = await websocket_connect(request)
            try:
                return await asyncio.wait_for(story(Browser(socket)), 15)
            finally:
                socket.close()

        return asyncio.run(run())


class _Stay(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *_args):
        return None


class Browser:
    """What a page knows."""

    def __init__(self, socket):
        self.socket = socket
        self.number, self.values, self.events, self.pictures, self.answers = 0, {}, [], [], {}

    async def read(self):
        """The next message; False where the connection has ended."""
        message = await self.socket.read_message()
        if message is None:
            return False
        if isinstance(message, bytes):
            length = int.from_bytes(message[:4], "little")
            self.pictures.append((json.loads(message[4 : 4 + length]), message[4 + length :]))
            return True
        told = json.loads(message)
        self.number = told.get("you", self.number)
        if "re" in told:
            self.answers[told["re"]] = told
        self.values |= told.get("set", {})
        for key in told.get("drop", []):
            self.values.pop(key, None)
        self.events += told.get("add", {}).get("events", [])
        return True

    async def until(self, holds):
        while not holds(self):
            assert await self.read(), "the connection has ended"
        return self

    def send(self, **message):
        self.socket.write_message(json.dumps(message))


@pytest.fixture(scope="module")
def console(tmp_path_factory):
    with contextlib.ExitStack() as stack:
        yield Console(tmp_path_factory.mktemp("console"), stack)


@pytest.fixture(scope="module")
def locked(tmp_path_factory, console):
    with contextlib.ExitStack() as stack:
        yield Console(tmp_path_factory.mktemp("locked"), stack, beside=console)


def test_a_page_shows_the_robot(console):
    page = console.browse(
        lambda browser: browser.until(
            lambda b: b.pictures and "graph" in b.values and "pose" in b.values.get("live", {})
        )
    )
    assert page.values["graph"] == {"vertices": 80, "maps": 2}
    assert page.values["places"].keys() == {"home", "gate"}
    assert page.values["state"]["name"] == "Repeat.Follow"
    assert page.values["route"]["runs"] == [[console.acted.taught.id, 0, 39]]
    assert page.values["process/tracker"]["present"]
    assert page.values["refused"]["pause"] == ""
    assert "finish or cancel" in page.values["refused"]["teach"]
    header, jpeg = page.pictures[0]
    assert jpeg.startswith(b"\xff\xd8")
    assert header["width"], header["height"] == (320, 200)


def test_features_lie_in_the_frame_that_they_were_matched_in(console):
    page = console.browse(lambda browser: browser.until(lambda b: any(header["points"] for header, _ in b.pictures)))
    header = next(header for header, _ in page.pictures if header["points"])
    assert len(header["points"]) == 160
    assert header["stream"] == "plain"


def test_after_the_first_message_only_what_changes_is_sent(console):
    async def story(browser):
        await browser.until(lambda b: "graph" in b.values and "live" in b.values)
        seen = set()
        for _ in range(30):
            browser.values = {}
            await browser.read()
            seen |= browser.values.keys()
        return seen

    seen = console.browse(story)
    assert "live" in seen
    assert not any(key.startswith(("v/", "map/", "places", "state", "route")) for key in seen)


def test_commands_reach_the_navigator_and_the_timeline(console):
    async def story(browser):
        browser.send(id=1, do="repeat", **{"with": {"goal": {"to": "gate", "mode": None}}})
        await browser.until(lambda b: 1 in b.answers and any("repeat: done" in e["text"] for e in b.events))
        return browser.answers[1]

    assert console.browse(story) == {"re": 1, "ok": True, "told": "repeat: done"}
    command = console.acted.orders[-1]
    assert (command.action, command.goal.to, command.environment) == ("repeat", "gate", "default")


def test_what_is_wrong_is_refused_with_a_sentence(console):
    before = len(console.acted.orders)
    assert console.do("fly") == (False, "the robot's page knows no 'fly'")
    assert console.do("pause", speed=3) == (False, "'pause' takes no 'speed'")
    done, told = console.do("teach", start_place="Front Gate")
    assert not done
    assert "a-z" in told
    assert "map:index" in console.do("position", vertex="x")[1]
    assert not console.do("restrict", restriction={"map": "x"})[0]
    assert not console.do("repeat", goal={"to": 3})[0]
    assert len(console.acted.orders) == before


def test_a_named_place_is_shown(console):
    vertex = f"{console.acted.taught.id}:7"
    assert console.do("name_place", place="bend", vertex=vertex)[0]
    page = console.browse(lambda browser: browser.until(lambda b: "bend" in b.values.get("places", {})))
    assert page.values["places"]["bend"] == [console.acted.taught.id, 7]


def test_a_merge_tries_the_vertices_around_the_one_that_was_clicked(console):
    assert console.do("merge", vertex=f"{console.acted.taught.id}:20")[0]
    indices = sorted(vertex.index for vertex in console.acted.orders[-1].candidates)
    assert indices == list(range(17, 24))


def test_stop_goes_straight_to_safety(console):
    status, _, text = console.request("/stop", body=b"")
    assert (status, json.loads(text)["told"]) == (200, "the emergency stop is latched")
    console.browse(lambda browser: browser.until(lambda b: b.values.get("safety", {}).get("latched")))
    assert console.request("/reset", body=b"")[0] == 200
    assert [command.action for command in console.acted.stops] == ["stop", "reset"]


def test_the_joystick_drives_while_it_is_held(console):
    bus = console.robot.bus("watcher")
    commands, sticks = bus.subscribe(topics.TELEOP), bus.subscribe(topics.JOYSTICK)
    follow = console.acted.state
    console.acted.state = State(stamp=1, name=StateName.TEACH_BRANCH, environment="default", since=now_ns(), reason="")

    async def story(browser):
        await browser.until(lambda b: b.values.get("refused", {}).get("teleop") == "")
        browser.send(drive=[1.0, 0.0, 5.0])
        await browser.until(lambda b: b.values.get("driver"))

    try:
        console.browse(story)
    finally:
        console.acted.state = follow
    eventually(lambda: (last := sticks.last()) and not last.message.held, "a page that has gone lets go")
    eventually(lambda: (last := commands.last()) and last.message.v == 0.0, "the last word is to stand")


def test_a_second_page_learns_who_drives(console):
    follow = console.acted.state
    console.acted.state = State(stamp=1, name=StateName.TEACH_BRANCH, environment="default", since=now_ns(), reason="")

    async def drive(browser):
        await browser.until(lambda b: b.values.get("refused", {}).get("teleop") == "")
        browser.send(drive=[0.0, 0.0, 5.0])
        await browser.until(lambda b: b.values.get("driver") == b.number)

    async def meet(first):
        await drive(first)
        second = Browser(await websocket_connect(f"ws://127.0.0.1:{console.port}/ws/robot"))
        await second.until(lambda b: b.values.get("driver") == first.number != b.number)
        second.socket.close()

    try:
        console.browse(meet)
    finally:
        console.acted.state = follow


def test_a_page_of_another_origin_is_refused_and_logged(console):
    assert console.status("/robot", Origin="http://evil.example") == 403
    assert console.status("/stop", body=b"", Origin="http://evil.example") == 403
    assert console.status("/robot", Host="evil.example") == 403
    with pytest.raises(HTTPClientError, match="403"):
        console.browse(lambda browser: browser.read(), Origin="http://evil.example")
    assert console.log().count("http://evil.example") == 3
    assert console.acted.stops[-1].action == "reset"


def test_an_oversized_message_ends_its_connection_and_no_other(console):
    async def story(browser):
        await browser.read()
        browser.send(padding="x" * 70_000)
        while await browser.read():
            pass
        return browser.socket.close_code

    async def huge(browser):
        browser.send(padding="x" * 3_000_000)
        while await browser.read():
            pass

    assert console.browse(story) == 1009
    console.browse(huge)
    eventually(lambda: console.log().count("a message of more than") == 2, "both are logged")
    assert console.status("/robot") == 200


def test_nonsense_ends_its_connection_alone(console):
    async def story(browser, text):
        await browser.read()
        browser.socket.write_message(text)
        while await browser.read():
            pass

    for text in ("nonsense", "[1]", b"\xff\x00", "[" * 60_000):
        console.browse(lambda browser, text=text: story(browser, text))
    assert console.request("/do/robot/cancel", body=b"[" * 60_000)[0] == 400
    assert console.status("/robot") == 200


def test_files_beside_the_page_are_not_served(console):
    for path in (
        "/static/common/../service.py",
        "/static/robot/..%2fpage.py",
        "/static/robot/%2e%2e/page.py",
        "/data/robot/background/../x",
    ):
        assert console.status(path) in (403, 404)


def test_nothing_is_loaded_from_elsewhere(console):
    _, headers, text = console.request("/robot")
    assert "default-src 'self'" in headers["Content-Security-Policy"]
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert "http://" not in text
    assert "https://" not in text


def test_the_console_killed_is_back_with_all_that_it_showed(console):
    console.robot.kill("console")
    console.start()
    page = console.browse(lambda browser: browser.until(lambda b: "graph" in b.values and "state" in b.values))
    assert page.values["state"]["name"] == "Repeat.Follow"


def test_without_the_token_there_is_only_the_login(locked):
    assert locked.status("/static/robot/page.js") == 401
    assert locked.status("/data/robot/background/x.png") == 401
    assert locked.status("/do/robot/cancel", body=b"{}") == 401
    assert locked.status("/stop", body=b"") == 401
    for path in ("/", "/robot"):
        status, headers, _ = locked.request(path)
        assert (status, headers["Location"]) == (302, "/login")
    with pytest.raises(HTTPClientError, match="401"):
        locked.browse(lambda browser: browser.read())


def test_the_token_opens_a_session_that_outlives_the_console(locked):
    status, headers, _ = locked.request("/login", body=urllib.parse.urlencode({"token": TOKEN}).encode())
    assert status == 302
    assert "HttpOnly" in headers["Set-Cookie"]
    assert "SameSite=Strict" in headers["Set-Cookie"]
    cookie = headers["Set-Cookie"].partition(";")[0]
    assert locked.status("/robot", Cookie=cookie) == 200
    locked.robot.kill("console")
    locked.start()
    assert locked.browse(lambda browser: browser.read(), Cookie=cookie)
    assert locked.browse(lambda browser: browser.read(), Authorization=f"Bearer {TOKEN}")
    assert locked.browse(lambda browser: browser.read(), Authorization=f"Bearer {TOKEN}", Origin="https://ops.example")


def test_who_guesses_waits_and_is_logged(locked):
    guess = {"Authorization": "Bearer 0123456789abcdef9999"}
    statuses = [locked.status("/robot", **guess) for _ in range(6)]
    assert statuses[0] == 302
    assert 429 in statuses[1:]
    assert "a wrong token" in locked.log()
    assert "too many wrong tokens" in locked.log()
    assert TOKEN not in locked.log()
    assert "9999" not in locked.log()
    eventually(lambda: locked.status("/robot", Authorization=f"Bearer {TOKEN}") == 200, "the right one is heard again")


def test_a_port_in_use_keeps_the_page_away_and_nothing_else(console, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        robot = Robot(tmp_path, f"[console]\nport = {port}\n", "r3", console.robot)
        with robot:
            robot.start("console")
            eventually(lambda: "cannot be served" in robot.log("console"), "it is logged")
            other.close()
            eventually(lambda: _answers(f"http://127.0.0.1:{port}/robot"), "the page is served once the port is free")


def _answers(url):
    with contextlib.suppress(OSError), urllib.request.urlopen(url, timeout=1) as answer:  # noqa: S310, our own page
        return answer.status == 200
    return False
