"""Debian's Chromium, and what an operator does on the robot's page."""

import contextlib
import shutil

import pytest

CHROMIUM = shutil.which("chromium")
DEADLINE_MS = 20_000


@contextlib.contextmanager
def chromium():
    """A headless browser; skips where none is installed."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
    if CHROMIUM is None:
        pytest.skip("no chromium is installed: apt install chromium")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


class RobotPage:
    """The robot's page in a browser, in an operator's words."""

    def __init__(self, browser, url):
        self.errors = []
        self.requests = []
        self.page = browser.new_page(viewport={"width": 1440, "height": 900}, color_scheme="light")
        self.page.set_default_timeout(DEADLINE_MS)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(url)
        self.is_live()

    def is_live(self):
        self.page.wait_for_function("() => document.getElementById('link').textContent === 'live'")

    def is_away(self):
        self.page.wait_for_function("() => document.getElementById('link').textContent === 'reconnecting'")

    def press(self, command):
        """A button, once it can act."""
        self.page.wait_for_function(
            f"() => document.getElementById('do-{command}').getAttribute('aria-disabled') === 'false'"
        )
        self.page.click(f"#do-{command}")

    def why_not(self, command):
        """Why a button cannot act; empty where it can."""
        return self.page.get_attribute(f"#do-{command}", "title")

    def answer(self, **values):
        """Fills in the dialog, and agrees."""
        for name, value in values.items():
            self.page.fill(f"#dialog [name={name}]", value)
        self.page.click("#dialog button[type=submit]")

    def state(self, *words, deadline_ms=DEADLINE_MS):
        """Waits for a state."""
        self.page.wait_for_function(
            "words => words.some(one => document.getElementById('state-name').textContent.startsWith(one))",
            arg=list(words),
            timeout=deadline_ms,
        )

    def choose(self, map_id, index, item=None):
        """Clicks a vertex on the map, and an item of its menu where one opens."""
        x, y = self.page.evaluate(
            """([map, index]) => {
                const { view, graph } = globalThis.vtrMap;
                const box = view.canvas.getBoundingClientRect();
                const [x, y] = view.toPixel(...graph.at(map, index));
                return [box.x + x, box.y + y];
            }""",
            [map_id, index],
        )
        self.page.mouse.click(x, y)
        if item is not None:
            self.page.get_by_role("menuitem", name=item).click()

    def hold(self, key, until):
        """Holds a key on the joystick until a condition is true."""
        self.page.focus("#pad")
        self.page.keyboard.down(key)
        try:
            until()
        finally:
            self.page.keyboard.up(key)

    def section(self, key):
        """What the page was told last."""
        return self.page.evaluate("key => globalThis.vtrLink.values.get(key)", key)

    def process(self, name):
        """What the table says of a process."""
        return self.page.inner_text(f"#health tr:has(span:text-is('{name}'))")

    def wait_process(self, name, gone, deadline_ms):
        """Waits until the table says that a process has gone, or is there."""
        self.page.wait_for_function(
            """([name, gone]) => [...document.querySelectorAll('#health tr')].some(
                row => row.cells[0].textContent === name && row.cells[1].textContent.includes('gone') === gone)""",
            arg=[name, gone],
            timeout=deadline_ms,
        )

    def pictures(self, folder, name):
        """The page at two widths, light and dark."""
        for width, height in ((1440, 1390), (390, 1500)):
            self.page.set_viewport_size({"width": width, "height": height})
            self.page.click("#map-fit")
            for theme in ("light", "dark"):
                while self.page.evaluate("document.documentElement.dataset.theme") != theme:
                    self.page.click("#theme")
                self.page.evaluate("document.activeElement.blur(), document.getElementById('toasts').replaceChildren()")
                self.page.wait_for_timeout(300)
                self.page.screenshot(path=folder / f"console-{name}-{width}-{theme}.png")
                assert self.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        self.page.set_viewport_size({"width": 1440, "height": 900})
