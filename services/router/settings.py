"""``[router]``: nothing to set beyond ``[bus]`` and ``[security]``, which the router shares with its clients."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Settings:
    """The router listens where ``[bus]`` and ``[security]`` say."""
