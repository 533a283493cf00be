"""Every message of the bus, from its model."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Iterator

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from common import messages
from common.messages import Message
from docs.drawing.markdown import inline, table
from docs.drawing.settings import default
from docs.drawing.topics import every, named
from docs.drawing.types import words

_HEAD = ("field", "type", "default")


def all_topics() -> str:
    """The table of topics, as the page of messages links to them."""
    return every(named().values()).replace("../messages.md#", "#")


def all_messages() -> str:
    """A heading, the docstring and the fields of every message."""
    return "\n".join(_one(kind) for kind in sorted(_kinds(), key=lambda kind: kind.__name__))


def _kinds() -> Iterator[type[BaseModel]]:
    for name in messages.__all__:
        kind = getattr(messages, name)
        if isinstance(kind, type) and issubclass(kind, BaseModel) and kind is not Message:
            yield kind


def _one(kind: type[BaseModel]) -> str:
    hints = typing.get_type_hints(kind, include_extras=True)
    rows = [
        (f"`{name}`", words(hints[name]), "" if field.default is PydanticUndefined else default(field.default))
        for name, field in kind.model_fields.items()
    ]
    fields = table(_HEAD, rows) if rows else "It has no fields.\n"
    return f"### {kind.__name__}\n\n{inline(inspect.getdoc(kind) or '')}\n\n{fields}"
