"""What ``mkdocs`` does beside its own: the order of the pages, README as the first one, and pictures of diagrams.

Pages that other parts of the project bring are put under their section where the order knows them, else under "More":
no page is ever lost, and none has to be there.
"""

from __future__ import annotations

import re
import sys
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from docs.drawing.states import picture

ORDER: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("Start", ("index.md", "tutorial.md", "calibration.md", "troubleshooting.md")),
    ("Use", ("console.md", "commands.md", "configuration.md", "recordings.md", "fleet.md", "ros2.md")),
    ("Deploy", ("deployment.md", "security.md", "scale.md")),
    (
        "How it works",
        ("architecture.md", "methods.md", "motion.md", "estimation.md", "lidar.md", "bearing.md", "environment.md"),
    ),
    ("What was measured", ("results.md", "results/*")),
    ("Reference", ("messages.md",)),
)
_SERVICES = "services"
_LINK = re.compile(r"(?<!!)\[(?P<text>[^\]]+)\]\((?P<target>[^)#\s]+)(?P<anchor>#[^)\s]*)?\)")
_MERMAID = re.compile(r"```mermaid\n(?P<diagram>.*?)```\n", re.DOTALL)


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """README becomes the first page; the navigation is made of the pages that there are."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8").replace("](docs/", "](")
    files.append(File.generated(config, "index.md", content=readme))
    config.nav = _navigation({file.src_uri for file in files.documentation_pages()})
    return files


def on_page_markdown(markdown: str, *, page: Any, config: MkDocsConfig, files: Files) -> str:
    """Diagrams become pictures; links to files of the project that are no pages become their names."""
    del config
    markdown = _MERMAID.sub(lambda found: picture(found["diagram"]), markdown)
    folder = ROOT if page.file.src_uri == "index.md" else (ROOT / "docs" / page.file.src_uri).parent
    known = {file.src_uri for file in files}

    def link(found: re.Match[str]) -> str:
        target = found["target"]
        if "://" in target or target.startswith("mailto:"):
            return found[0]
        path = (folder / target).resolve()
        inside = path.is_relative_to(ROOT / "docs") or (folder == ROOT and target in known)
        if inside:
            return found[0]
        if not path.exists():
            raise PluginError(f"{page.file.src_uri}: a link leads to {target}, which does not exist")
        return f"{found['text']} (`{path.relative_to(ROOT)}`)" if found["text"] != str(target) else f"`{target}`"

    return _LINK.sub(link, markdown)


def _navigation(pages: set[str]) -> list[Any]:
    """The sections in their order, with the pages that exist; those that no section names come last."""
    services = sorted(page for page in pages if page.startswith(f"{_SERVICES}/"))
    sections: list[Any] = [
        {title: [page for name in names for page in sorted(pages) if fnmatch(page, name)]} for title, names in ORDER
    ]
    sections.append({"Processes": services})
    named = {page for section in sections for names in section.values() for page in names}
    rest = sorted(pages - named)
    return [section for section in [*sections, {"More": rest}] if any(section.values())]
