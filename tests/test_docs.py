"""The documentation says what the code does."""

import ast
import importlib.util
import re
import shlex

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config

from cli.app import command_line
from cli.groups import DefaultGroup
from docs.drawing.settings import every
from tests.processes import ROOT

DRAW = ROOT / "docs" / "draw.py"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
_SHELL = re.compile(r"```(?:sh|console)[^\n]*\n(.*?)```", re.DOTALL)
_PYTHON = re.compile(r"```python[^\n]*\n(.*?)```", re.DOTALL)
_INLINE = re.compile(r"`((?:\.venv/bin/)?vtr [^`]+)`")
_SETTING = re.compile(r"`\[([a-z_.]+)\](?: (\w+)(?= =|`))?")
_LOADED = re.compile(r"""<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=["']?(?:https?:)?//[^\s"'>]+""")
_FROM_CSS = re.compile(r"""(?:@import\s+|url\()["']?(?:https?:)?//[^)"']+""")


def _drawing():
    spec = importlib.util.spec_from_file_location("docs_draw", DRAW)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


DRAWING = _drawing()


@pytest.mark.parametrize("page", DRAWING.pages(), ids=lambda page: page.name)
def test_what_a_page_shows_of_the_code_is_what_the_code_has(page):
    assert page.is_file(), "python docs/draw.py writes it"
    assert page.read_text(encoding="utf-8") == DRAWING.pages()[page], "python docs/draw.py draws it anew"


def test_every_part_is_shown_somewhere():
    text = "".join(DRAWING.pages().values())
    assert set(re.findall(r"<!-- drawn: ([^>]+) -->", text)) == set(DRAWING.parts())


def test_every_setting_is_explained():
    assert [name for name, one in every().items() if not one.text] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_of_the_pages_imports_what_there_is(page):
    for block in _PYTHON.findall(page.read_text(encoding="utf-8")):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] in {"common", "services", "cli"}:
                module = importlib.import_module(node.module)
                for one in node.names:
                    assert hasattr(module, one.name) or importlib.util.find_spec(f"{node.module}.{one.name}"), one.name


def test_settings_that_the_pages_name_exist():
    keys = set(every())
    tables = {part for key in keys for part in ancestors(key)} | {"calibration.mounting", "router"}
    for page in PAGES:
        for table, key in _SETTING.findall(page.read_text(encoding="utf-8")):
            assert table in tables, f"{page.name}: [{table}]"
            assert not key or f"{table}.{key}" in keys, f"{page.name}: [{table}] {key}"


def ancestors(key):
    """The tables that a key is in."""
    parts = key.split(".")[:-1]
    return {".".join(parts[:count]) for count in range(1, len(parts) + 1)}


def mentioned(text):
    """Every ``vtr`` command of a page, as its words."""
    lines = [line for block in _SHELL.findall(text) for line in block.replace("\\\n", " ").splitlines()]
    pieces = [piece for line in lines for piece in re.split(r";|&&|\|(?!\w)", line)] + _INLINE.findall(text)
    for piece in pieces:
        words = shlex.split(piece, comments=True)
        if words and words[0].removeprefix(".venv/bin/") == "vtr":
            yield [word for word in words[1:] if word not in {"...", "…"}]


def parse(words):
    """Goes through a command as the command line does, and neither runs it nor looks at its values."""
    command, context, words = command_line(), None, list(words)
    while getattr(command, "commands", None):
        context = command.context_class(command, info_name="vtr", parent=context, resilient_parsing=True)
        while words and words[0] in ("--debug", "--version", "--help", "--install-completion", "--show-completion"):
            words.pop(0)
        if not words:
            return
        if isinstance(command, DefaultGroup) and words[0] not in command.commands:
            words.insert(0, command.default)
        assert words[0] in command.commands, f"there is no command '{words[0]}'"
        command = command.commands[words.pop(0)]
    context = command.context_class(command, info_name="vtr", parent=context)
    command.make_parser(context).parse_args(args=words)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_that_a_page_mentions_exists_with_its_options(page):
    for words in mentioned(page.read_text(encoding="utf-8")):
        try:
            parse(words)
        except Exception as error:  # noqa: BLE001, whatever the parser says of it
            pytest.fail(f"vtr {' '.join(words)}: {error}")


def test_a_command_that_does_not_exist_would_be_found():
    parse(["maps", "rm", "MAP", "--yes"])
    for wrong in (["fly"], ["maps", "fly"], ["repeat", "shed", "--fast"]):
        with pytest.raises(Exception, match=r"fly|--fast"):
            parse(wrong)


def _written():
    """Every text in the code, with an ellipsis where something is put in."""
    for folder in ("cli", "common", "services"):
        for file in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr):
                    yield "".join(str(one.value) if isinstance(one, ast.Constant) else "…" for one in node.values)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield node.value


def test_troubleshooting_explains_sentences_that_the_code_says():
    text = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    sentences = [line.removeprefix("#### ") for line in text.splitlines() if line.startswith("#### ")]
    written = set(_written())
    assert len(sentences) > 30
    for sentence in sentences:
        if sentence != "the base is silent or does not obey":  # what nobody can say
            assert any(one.startswith(sentence) for one in written), sentence


def test_files_that_the_pages_name_exist():
    named = re.compile(r"`((?:services|common|cli|tests|bench|deploy|docs)/[\w./-]+)`")
    for page in PAGES:
        for path in named.findall(page.read_text(encoding="utf-8")):
            assert (ROOT / path).exists() or (ROOT / f"{path}.py").exists(), f"{page.name}: {path}"


def test_the_site_builds_strictly_shows_every_page_and_loads_nothing_from_outside(tmp_path):
    site = tmp_path / "site"
    build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(site), strict=True))
    for page in PAGES[1:]:
        assert (site / page.relative_to(ROOT / "docs")).with_suffix(".html").is_file()
    index = (site / "index.html").read_text(encoding="utf-8")
    for service in (ROOT / "docs" / "services").glob("*.md"):
        assert f"services/{service.stem}.html" in index, "each page is in the navigation"
    for file in site.rglob("*.html"):
        text = file.read_text(encoding="utf-8")
        assert _LOADED.findall(text) == [], file.name
        assert "class=mermaid" not in text, "Material would load the program that draws it from outside"
        assert 'class="mermaid"' not in text, "Material would load the program that draws it from outside"
    assert [found for file in site.rglob("*.css") for found in _FROM_CSS.findall(file.read_text())] == []
    assert '<svg class="states"' in (site / "motion.html").read_text(encoding="utf-8")
