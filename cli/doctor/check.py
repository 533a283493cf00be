"""A row of the doctor's report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["ok", "warn", "fail"]


@dataclass(frozen=True, slots=True)
class Check:
    """One row of the report: what was looked at, how it is, and what to do where it is not well."""

    name: str
    verdict: Verdict
    text: str
    advice: str = ""
