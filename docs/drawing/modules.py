"""What is in a service's folder: each module with the first sentence of its docstring."""

from __future__ import annotations

import ast
from pathlib import Path

from docs.drawing.markdown import sentence, table

_ROOT = Path(__file__).resolve().parents[2]


def about(service: str) -> str:
    """The first sentence on a service as a whole."""
    return _first(_ROOT / "services" / service / "__init__.py")


def of_service(service: str) -> str:
    """One row a module or folder, in the order of their paths."""
    folder = _ROOT / "services" / service
    files = sorted(path for path in folder.rglob("*.py") if path.name != "__main__.py")
    rows = [(f"`{_name(path, folder)}`", _first(path)) for path in files]
    return table(("module", "what it does"), [row for row in rows if row[1]])


def _name(path: Path, folder: Path) -> str:
    relative = path.relative_to(folder)
    return (
        (f"{relative.parent}/" if relative.parent.name else "the folder")
        if path.name == "__init__.py"
        else str(relative)
    )


def _first(path: Path) -> str:
    return sentence(ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))))
