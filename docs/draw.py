"""Draws those parts of the pages that the code knows: ``python docs/draw.py`` writes them, a test compares them."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path

PAGES = Path(__file__).resolve().parent
_PART = re.compile(r"(?P<begin><!-- drawn: (?P<name>[^>]+) -->\n)(?P<now>.*?)(?P<end><!-- end -->)", re.DOTALL)
if str(PAGES.parent) not in sys.path:
    sys.path.insert(0, str(PAGES.parent))

from cli.processes import FLEET, OPTIONAL, ROBOT
from cli.robot import settings_kinds
from common.access.page import rights_table
from docs.drawing import commands, messages, modules, processes, settings, terminal, topics
from services.navigator.hierarchy import diagram
from services.safety.page import motion_table, truth_table


@cache
def parts() -> Mapping[str, str]:
    """Each part by the name that its page gives it."""
    services = settings_kinds((*ROBOT, *OPTIONAL, *FLEET))
    tables = {**settings.of_common(), **services}
    return {
        "state diagram": f"```mermaid\n{diagram()}```\n",
        "motion table": motion_table(),
        "truth table": truth_table(),
        "rights": rights_table(),
        "processes": processes.every(),
        "fleet processes": processes.of_fleet(),
        "all topics": messages.all_topics(),
        "all messages": messages.all_messages(),
        "all commands": commands.all_commands(),
        "terminal view": terminal.example(),
        **{f"topics of {name}": topics.of_service(name) for name in services},
        **{f"modules of {name}": modules.of_service(name) for name in services},
        **{f"settings of {name}": settings.drawn(name, kind) for name, kind in tables.items()},
    }


def drawn(text: str) -> str:
    """A page with its parts as the code has them now."""
    known = parts()

    def part(found: re.Match[str]) -> str:
        return f"{found['begin']}{known.get(found['name'], found['now'])}{found['end']}"

    return _PART.sub(part, text)


def pages() -> dict[Path, str]:
    """Every page that has such parts, and what it has to be; a service without a page gets one."""
    texts = {page: page.read_text(encoding="utf-8") for page in sorted(PAGES.rglob("*.md"))}
    for process in (*ROBOT, *OPTIONAL, *FLEET):
        texts.setdefault(PAGES / "services" / f"{process.name}.md", _new_page(process.name))
    return {page: drawn(text) for page, text in texts.items() if "<!-- drawn: " in text}


def _new_page(service: str) -> str:
    """The page of a service of which nothing more is said yet."""
    title = f"# {service.capitalize()}\n\n{modules.about(service)}\n"
    kinds = {"topics": "Topics", "settings": "Configuration", "modules": "Modules"}
    return title + "".join(
        f"\n## {heading}\n\n<!-- drawn: {kind} of {service} -->\n<!-- end -->\n" for kind, heading in kinds.items()
    )


if __name__ == "__main__":
    for page, text in pages().items():
        page.write_text(text, encoding="utf-8")
