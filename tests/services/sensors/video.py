"""Video files that stand in for capture devices."""

import cv2
import numpy as np


def write_video(path, frames, rate=20.0, codec="FFV1"):
    """Writes frames (H, W) or (H, W, 3) RGB losslessly."""
    height, width = frames[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), rate, (width, height))
    assert writer.isOpened()
    for frame in frames:
        code = cv2.COLOR_GRAY2BGR if frame.ndim == 2 else cv2.COLOR_RGB2BGR
        writer.write(cv2.cvtColor(frame, code))
    writer.release()
    return path


def numbered(count, size=(64, 48), offset=0):
    """Grey frames whose level tells their number."""
    return [np.full((size[1], size[0]), 10 * k + offset, np.uint8) for k in range(count)]
