"""Markdown that the other modules write."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; a bar in a cell is text."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(_cell(cell) for cell in row)} |\n" for row in lines)


def sentence(text: str | None) -> str:
    """The first paragraph of a docstring as one line, with Sphinx's roles and double backticks as Markdown has them."""
    paragraph = (text or "").strip().split("\n\n")[0]
    return inline(" ".join(paragraph.split()))


def inline(text: str) -> str:
    """A docstring's text in Markdown."""
    for role in (":class:", ":data:", ":mod:", ":func:", ":meth:"):
        text = text.replace(role, "")
    return text.replace("``", "`")


def anchor(heading: str) -> str:
    """What a link to a heading of these pages ends with."""
    return (
        "".join(letter for letter in heading.lower() if letter.isalnum() or letter in "-_ ").strip().replace(" ", "-")
    )


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
