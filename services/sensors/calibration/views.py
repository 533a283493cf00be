"""The pairs of images of a set, and which of them serve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.sensors.calibration.detection import Detection
from services.sensors.calibration.errors import CalibrationError

Array = NDArray[np.float64]

MIN_VIEWS = 8
"""Fewer poses of the board leave the lens's parameters to chance."""
SAME_POSE = 0.01
"""A board whose corners are nearer than this part of the image's width to those of another view stands as there."""


@dataclass(frozen=True, slots=True)
class View:
    """One pair of images: its name and what is seen of the board in each."""

    name: str
    left: Detection
    right: Detection

    @property
    def reason(self) -> str:
        """Why the pair is of no use, empty where it is."""
        for side, seen in (("left", self.left), ("right", self.right)):
            if seen.reason:
                return f"{side} image: {seen.reason}"
        return ""


def displacement(a: Detection, b: Detection) -> float:
    """Mean distance of the corners that two detections share, pixels; infinite where they share none."""
    _, first, second = np.intersect1d(a.ids, b.ids, return_indices=True)
    if len(first) == 0:
        return float("inf")
    return float(np.linalg.norm(a.points[first] - b.points[second], axis=1).mean())


def select(views: Sequence[View], width: int) -> tuple[list[View], dict[str, str]]:
    """The views that serve, and for each of the others, by name, the reason why it does not.

    Raises:
        CalibrationError: too few serve; the sentence says what is wrong with most of the others.
    """
    kept: list[View] = []
    dropped: dict[str, str] = {}
    for view in views:
        reason = view.reason
        twin = next((k for k in kept if displacement(k.left, view.left) < SAME_POSE * width), None)
        if not reason and twin is not None:
            reason = f"the board stands as in {twin.name}"
        if reason:
            dropped[view.name] = reason
        else:
            kept.append(view)
    if len(kept) < MIN_VIEWS:
        raise CalibrationError(_too_few(views, kept, dropped))
    return kept, dropped


def _too_few(views: Sequence[View], kept: Sequence[View], dropped: dict[str, str]) -> str:
    """What is wrong with a set of which too little is left, by the reason that most pairs were dropped for."""
    pairs = "pair" if len(views) == 1 else "pairs"
    begin = f"{len(kept)} of {len(views)} {pairs} of images can be used, {MIN_VIEWS} are needed"
    if not dropped:
        return f"{begin}: take more, with the board at other places, distances and tilts"
    kinds = {
        "blurred": "hold the board still, give more light, and focus the cameras",
        "stands as in": "the board hardly moves from pair to pair: change its place, distance and tilt between them",
        "corners": "bring the board nearer, wholly into both images, and light it evenly",
        "no marker": "the board must be in both images, and be the one that was named",
        "contrast": "check exposure and lens caps",
    }
    counts = {kind: sum(kind in reason for reason in dropped.values()) for kind in kinds}
    kind = max(counts, key=lambda k: counts[k])
    name, reason = next((n, r) for n, r in dropped.items() if kind in r)
    return f"{begin}: {kinds[kind]} ({counts[kind]} pairs as {name}: {reason})"
