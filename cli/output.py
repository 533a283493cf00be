"""What a command prints: its result on standard output, as JSON or for a reader; progress on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.progress import Progress

_WIDTH = 200


def emit(data: Any, text: RenderableType, *, as_json: bool) -> None:  # noqa: ANN401, whatever JSON can hold
    """Prints ``data`` as JSON, or else ``text``."""
    if as_json:
        sys.stdout.write(json.dumps(data, default=str, allow_nan=False) + "\n")
        sys.stdout.flush()
    else:
        console().print(text)


def on_terminal() -> bool:
    """Whether standard output is a terminal that can be drawn on again and again."""
    return console().is_terminal and not console().is_dumb_terminal


def console() -> Console:
    """Standard output for a reader: colours on terminals alone and without NO_COLOR, wide lines where there is none."""
    from rich.console import Console

    return Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else _WIDTH)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> RenderableType:
    """A table of text; columns whose every cell is a number are aligned to the right."""
    from rich import box
    from rich.table import Table

    made = Table(title=title or None, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for index, name in enumerate(columns):
        numbers = bool(rows) and all(isinstance(row[index], int | float) for row in rows)
        made.add_column(name, justify="right" if numbers else "left", overflow="fold")
    for row in rows:
        made.add_row(*("" if cell is None else str(cell) for cell in row))
    return made


def progress() -> Progress:
    """A progress display on standard error, for use as a context manager; silent where that is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
