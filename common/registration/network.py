"""A network's representation: an ONNX file, run by onnxruntime where that is installed, else by OpenCV.

The network takes one image, (1, 3, H, W) RGB or (1, 1, H, W) grey, float32 in [0, 1], and gives (1, c, h, w) or
(1, c, w): the fully convolutional part of a siamese network such as the thesis's, without the correlation after it.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from common.errors import ConfigurationError, ImageError
from common.registration import images
from common.registration.images import Image
from common.registration.onnx_file import input_shape
from common.registration.representation import Described

Array = NDArray[np.float32]
Run = Callable[[Array], Any]

DEFAULT_WIDTH = 512


class NetworkRepresentation:
    """What a network makes of an image that is brought to the size that it takes."""

    def __init__(self, model: Path, width: int | None = None) -> None:
        """Loads the ONNX file; images are brought to its own size, else to ``width`` pixels, their aspect kept.

        Raises:
            ConfigurationError: there is no such file, or it holds no network that takes an image.
        """
        try:
            content = model.read_bytes()
        except OSError as error:
            raise ConfigurationError(f"cannot read the model {model}: {error.strerror}") from error
        try:
            _, self._channels, self._height, own_width = _image_shape(content)
            self._run = _load(content)
        except Exception as error:  # each runtime has errors of its own
            raise ConfigurationError(f"{model} is no ONNX network that takes a grey or a colour image") from error
        self._width = own_width or width or DEFAULT_WIDTH
        self.name = f"network-{hashlib.sha256(content).hexdigest()[:16]}-{self._width}"

    def describe(self, image: Image) -> Described:
        """The representation of an image (H, W) or (H, W, 3) RGB.

        Raises:
            ImageError: it is no such image, or the network cannot be run on it, or gives no dense representation.
        """
        image = images.check(image)
        height, width = image.shape[:2]
        entering = self._entering(image)
        try:
            values = np.asarray(self._run(entering))
        except Exception as error:  # each runtime has errors of its own
            size = f"{entering.shape[3]}x{entering.shape[2]}"
            raise ImageError(f"the network cannot be run on an image of {size}: give it another width") from error
        if values.ndim == 3:
            values = values[:, :, None, :]
        if values.ndim != 4 or values.shape[0] != 1 or values.shape[3] < 2 or not np.isfinite(values).all():
            raise ImageError(f"the network's output of shape {values.shape} is no dense representation (1, c, h, w)")
        cell_height = height / width / values.shape[2]
        return Described(np.array(values[0], dtype=np.float32), width, height, cell_height, self.name)

    def _entering(self, image: Image) -> Array:
        """The image as the network takes it: (1, c, H, W) in [0, 1]."""
        planes = images.grey(image) if self._channels == 1 else images.colour(image)
        small = images.resized(planes, self._width, self._height)
        ordered = small[None] if small.ndim == 2 else small.transpose(2, 0, 1)
        return np.ascontiguousarray(ordered[None], dtype=np.float32) / np.float32(255.0)


def _image_shape(content: bytes) -> tuple[int | None, ...]:
    """Sizes (1, c, H, W) of the image that a network takes, None where any will do.

    Raises:
        ValueError: it takes something else.
    """
    shape = input_shape(content)
    if len(shape) != 4 or shape[0] not in {1, None} or shape[1] not in {1, 3}:
        raise ValueError(f"an input of shape {shape}")
    return shape


def _load(content: bytes) -> Run:
    """How to run a network on one array."""
    if importlib.util.find_spec("onnxruntime") is not None:
        session = importlib.import_module("onnxruntime").InferenceSession(content, providers=["CPUExecutionProvider"])
        name = session.get_inputs()[0].name
        return lambda planes: session.run(None, {name: planes})[0]
    net = cv2.dnn.readNetFromONNX(np.frombuffer(content, dtype=np.uint8))

    def run(planes: Array) -> Any:  # noqa: ANN401, OpenCV's own type
        net.setInput(planes)
        return net.forward()

    return run
