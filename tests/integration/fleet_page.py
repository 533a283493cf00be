"""The fleet's page in a browser, in the words of a person who plans."""

from __future__ import annotations

import io
import os
from pathlib import Path

from PIL import Image

from tests.integration.browser import DEADLINE_MS

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"
WIDE, PHONE = (1440, 1000), (390, 844)
LIGHT, DARK = "light", "dark"


class FleetPage:
    """The page, what went wrong in it, and the hosts that it asked."""

    def __init__(self, browser, address, size=WIDE, scheme=LIGHT):
        width, height = size
        self.page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
        self.page.set_default_timeout(DEADLINE_MS)
        self.errors = []
        self.hosts = set()
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.hosts.add(request.url.split("/")[2]))
        self.page.goto(address)

    def planned(self):
        """Waits until there is a plan."""
        self.page.wait_for_selector("#plan li")
        self.page.wait_for_selector("#day .curve.chosen")
        return self

    def plan(self):
        """The plan's sum as it is written, and its maps."""
        maps = self.page.locator("#plan .what").evaluate_all("found => found.map((one) => one.title)")
        return self.page.locator("#plan-sum").inner_text().split()[1], maps

    def costs(self):
        """Every map's cost as it is written."""
        rows = self.page.locator("#costs tbody tr")
        of_row = "found => found.map((one) => [one.dataset.map, one.querySelector('.total').textContent])"
        return dict(rows.evaluate_all(of_row))

    def maps(self):
        """How many maps the page lists."""
        return self.page.locator("#costs-note").inner_text()

    def robot(self, name):
        """What the page says of a robot, in words."""
        return self.page.locator(f'#robots tr[data-robot="{name}"]').inner_text().split()

    def says(self, text):
        """Waits until it says what is missing."""
        self.page.locator("#missing").get_by_text(text).wait_for(state="visible")

    def complains_no_more(self):
        """Waits until nothing is missing."""
        self.page.locator("#missing").wait_for(state="hidden", timeout=30_000)

    def fits(self):
        """Whether nothing is wider than the window."""
        return self.page.evaluate("document.documentElement.scrollWidth <= innerWidth")

    def is_dark(self):
        """Whether its ground is."""
        colour = self.page.evaluate("getComputedStyle(document.body).backgroundColor")
        return sum(map(int, colour[4:-1].split(","))) < 380

    def keep(self, name):
        """Puts a picture of the whole page into the docs, where VTR_SCREENSHOTS is set."""
        if os.environ.get("VTR_SCREENSHOTS"):
            size = self.page.evaluate("({ width: innerWidth, height: document.documentElement.scrollHeight })")
            self.page.set_viewport_size(size)  # so that what keeps to the window's edge stands at the page's
            self.page.wait_for_timeout(300)
            picture = Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")
            picture.quantize(200, dither=Image.Dither.NONE).save(IMAGES / f"{name}.png", optimize=True)
