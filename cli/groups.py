"""A group of commands one of which is meant where none is named."""

from __future__ import annotations

from typing import Any, ClassVar

import typer.core


class DefaultGroup(typer.core.TyperGroup):
    """``vtr group ARGUMENTS`` is ``vtr group default ARGUMENTS``, unless the first argument names another command."""

    default: ClassVar[str]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401, click's or typer's own
        """Puts the default command's name before arguments that name none."""
        named = bool(args) and (args[0] in self.commands or args[0] in ("--help", "-h"))
        return list(super().parse_args(ctx, args if named else [self.default, *args]))
