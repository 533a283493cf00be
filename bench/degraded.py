"""Localization on spoilt images: even pairs of a KITTI recording taught, odd ones repeated, beside SIFT and PnP.

The odd pairs are darkened by half, put through gamma 2, noised, blurred, or a third of them is hidden. Without the
recordings in ``VTR_DATA`` (or ``../shared/data``) there is nothing to measure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

from bench import table
from bench.recordings import kitti
from common import geometry
from common.camera import StereoCamera
from common.geometry import Array
from services.estimator.offline import run_localization
from services.sensors.recordings import StereoPair, StereoRecording

Image = NDArray[np.uint8]

_NEAR_M, _NEAR_DEG = 0.5, 5.0
"""A pose farther off than either is wrong."""


def _hidden(image: Image, _: np.random.Generator) -> Image:
    out = image.copy()
    out[:, : image.shape[1] // 3] = 0
    return out


SPOILT: dict[str, Callable[[Image, np.random.Generator], Image]] = {
    "as it is": lambda image, _: image,
    "darkened by half": lambda image, _: (image // 2).astype(np.uint8),
    "gamma 2": lambda image, _: np.rint(255.0 * (image / 255.0) ** 2).astype(np.uint8),
    "noise, sigma 10": lambda image, rng: np.clip(image + rng.normal(0.0, 10.0, image.shape), 0, 255).astype(np.uint8),
    "blur, sigma 1.5": lambda image, _: np.asarray(cv2.GaussianBlur(image, (0, 0), 1.5), np.uint8),
    "a third hidden": _hidden,
}


@dataclass(frozen=True)
class _Half:
    """Every other pair of a recording, its images spoilt."""

    whole: StereoRecording
    first: int
    spoil: Callable[[Image, np.random.Generator], Image]

    @property
    def camera(self) -> StereoCamera:
        return self.whole.camera

    @property
    def poses_truth(self) -> Array | None:
        truth = self.whole.poses_truth
        return None if truth is None else truth[self.first :: 2]

    def __iter__(self) -> Iterator[StereoPair]:
        rng = np.random.default_rng(0)
        for pair in islice(self.whole, self.first, None, 2):
            yield StereoPair(pair.stamp_ns, self.spoil(pair.left, rng), self.spoil(pair.right, rng))


def _ours(teach: _Half, repeat: _Half) -> tuple[float, Array, Array]:
    run = run_localization(teach, repeat)
    assert run.position_errors is not None
    assert run.rotation_errors is not None
    return run.coverage, run.position_errors[run.success], np.degrees(run.rotation_errors[run.success])


def _points(pair: StereoPair, camera: StereoCamera) -> tuple[Array, Image, Array]:
    """Pixels, descriptors and points of SIFT features with a stereo match."""
    sift = cv2.SIFT.create(2000)
    (left, a), (right, b) = (sift.detectAndCompute(i, None) for i in (pair.left, pair.right))
    if a is None or b is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32), np.zeros((0, 3))
    matches = cv2.BFMatcher(cv2.NORM_L2, crossCheck=True).match(a, b)
    p, q = (np.array([k[getattr(m, i)].pt for m in matches]) for k, i in ((left, "queryIdx"), (right, "trainIdx")))
    good = (np.abs(p[:, 1] - q[:, 1]) < 2.0) & (p[:, 0] - q[:, 0] > 1.0)
    points = camera.triangulate(np.column_stack([p[good], q[good, 0]]))
    return p[good], a[[m.queryIdx for m in matches]][good], points


def _naive(teach: _Half, repeat: _Half) -> tuple[float, Array, Array]:
    """SIFT, ratio test and ``solvePnPRansac`` against the taught pair before; 15 inliers are a success."""
    camera = teach.camera
    K = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    truth = teach.poses_truth, repeat.poses_truth
    assert truth[0] is not None
    assert truth[1] is not None
    position, rotation, count = [], [], 0
    for i, (stored, live) in enumerate(zip(teach, repeat, strict=False)):
        count += 1
        _, taught, points = _points(stored, camera)
        pixels, seen, _ = _points(live, camera)
        if min(len(taught), len(seen)) < 15:
            continue
        both = cv2.BFMatcher(cv2.NORM_L2).knnMatch(taught, seen, k=2)
        kept = [m for m, n in both if m.distance < 0.8 * n.distance]
        if len(kept) < 15:
            continue
        found, turn, shift, inliers = cv2.solvePnPRansac(
            points[[m.queryIdx for m in kept]], pixels[[m.trainIdx for m in kept]], K, None,
            flags=cv2.SOLVEPNP_P3P, reprojectionError=2.0,
        )  # fmt: skip
        if not found or inliers is None or len(inliers) < 15:
            continue
        T_map_live = geometry.inverse(geometry.transform(geometry.so3_exp(turn[:, 0]), shift[:, 0]))
        error = geometry.inverse(geometry.inverse(truth[0][i]) @ truth[1][i]) @ T_map_live
        position.append(float(np.linalg.norm(error[:3, 3])))
        rotation.append(float(np.degrees(geometry.rotation_angle(error))))
    return len(position) / max(count, 1), np.array(position), np.array(rotation)


def main() -> None:
    """Prints coverage, errors and wrong successes of both ways."""
    cv2.setNumThreads(1)
    rows: list[list[object]] = []
    for name in ("kitti06_gray_stereo", "kitti02_colour_stereo"):
        recording = kitti(name)
        if recording is None:
            print(f"spoilt images: {name} is not in VTR_DATA, nothing is measured")
            continue
        teach = _Half(recording, 0, SPOILT["as it is"])
        for label, spoil in SPOILT.items():
            for way, localize in (("retraverse", _ours), ("SIFT + PnP", _naive)):
                coverage, position, rotation = localize(teach, _Half(recording, 1, spoil))
                wrong = int(((position > _NEAR_M) | (rotation > _NEAR_DEG)).sum())
                median, most = (100 * np.median(position), 100 * position.max()) if len(position) else (np.nan, np.nan)
                rows.append([name[:7], label, way, 100 * coverage, float(median), float(most), wrong])
    columns = ["recording", "images", "way", "localized, %", "median cm", "most cm", "wrong"]
    table.show(
        "spoilt images: odd pairs localized on even ones",
        columns,
        rows,
        note=f"wrong: told as a success, and off by more than {_NEAR_M} m or {_NEAR_DEG:.0f}°",
    )


if __name__ == "__main__":
    main()
