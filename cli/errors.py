"""The error of a command that cannot be carried out, beside those of :mod:`common.errors`."""

from __future__ import annotations

from common.errors import RetraverseError


class CommandError(RetraverseError):
    """A command that cannot be carried out: nothing was changed unless the sentence says so."""
