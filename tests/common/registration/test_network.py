"""Networks in ONNX files, made here: real ones, with weights that detect edges."""

import importlib.util

import numpy as np
import pytest

from common.errors import ConfigurationError, ImageError
from common.registration import NetworkRepresentation, Registrar
from common.registration.onnx_file import input_shape
from tests.common.registration.scenes import panorama, window

onnx = pytest.importorskip("onnx", reason="the package onnx makes the networks of these tests")
from onnx import TensorProto, helper, numpy_helper  # noqa: E402, after it is known to be there

SCENE = panorama()


def edges(channels):
    """Weights (4, channels, 5, 5): derivatives along and across, each in both directions."""
    ramp = np.outer(np.hanning(7)[1:-1], np.linspace(-1, 1, 5)).astype(np.float32)
    return np.stack([np.stack([kernel / channels] * channels) for kernel in (ramp, -ramp, ramp.T, -ramp.T)])


@pytest.fixture
def save(tmp_path):
    """Writes a network: a strided convolution, rectified; without its height where that is asked for."""

    def write(channels=3, size=("h", "w"), *, flat=False, inputs=1):
        nodes = [
            helper.make_node("Conv", ["image", "weights"], ["raw"], strides=[4, 4], pads=[2, 2, 2, 2]),
            helper.make_node("Relu", ["raw"], ["dense"]),
        ]
        if flat:
            axes = numpy_helper.from_array(np.array([2]), "axes")
            nodes.append(helper.make_node("ReduceMean", ["dense", "axes"], ["out"], keepdims=0))
        entries = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, channels, *size]) for n in ("image", "b")]
        name, shape = ("out", [1, 4, None]) if flat else ("dense", [1, 4, None, None])
        weights = [numpy_helper.from_array(edges(channels), "weights")] + ([axes] if flat else [])
        # As older files do, the weights are named among the inputs too.
        entries = [*entries[:inputs], helper.make_tensor_value_info("weights", TensorProto.FLOAT, [4, channels, 5, 5])]
        made = helper.make_graph(nodes, "net", entries, [helper.make_tensor_value_info(name, 1, shape)], weights)
        path = tmp_path / "net.onnx"
        model = helper.make_model(made, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
        path.write_bytes(model.SerializeToString())
        return path

    return write


@pytest.mark.parametrize("channels", [1, 3])
def test_a_network_finds_a_known_shift(save, channels):
    registrar = Registrar(NetworkRepresentation(save(channels)))
    live, stored = window(SCENE, 345), window(SCENE, 400)
    colour = np.repeat(live[:, :, None], 3, axis=2)
    assert registrar.representation.describe(stored).values.shape == (4, 48, 128)
    assert abs(registrar.register(colour, stored).shift_px - 55) < 1.0


def test_the_values_are_those_of_the_convolution(save):
    image = window(SCENE, 100)
    values = NetworkRepresentation(save(1)).describe(image).values
    padded = np.pad(image / 255.0, 2)
    patch = padded[4 * 10 : 4 * 10 + 5, 4 * 60 : 4 * 60 + 5]
    expected = np.maximum(0.0, (edges(1)[:, 0] * patch).sum(axis=(1, 2)))
    assert np.allclose(values[:, 10, 60], expected, atol=1e-4)


def test_a_network_without_rows_serves_too(save):
    registrar = Registrar(NetworkRepresentation(save(flat=True)))
    assert registrar.representation.describe(window(SCENE, 0)).values.shape == (4, 1, 128)
    assert abs(registrar.register(window(SCENE, 380), window(SCENE, 400)).shift_px - 20) < 2.0


def test_the_size_is_the_networks_own_else_the_one_that_was_asked_for(save):
    image = window(SCENE, 0)
    assert NetworkRepresentation(save(3, (96, 256)), 320).describe(image).values.shape == (4, 24, 64)
    assert NetworkRepresentation(save(3), 320).describe(image).values.shape == (4, 30, 80)


def test_representations_of_two_networks_do_not_compare(save):
    grey, colour = NetworkRepresentation(save(1)), NetworkRepresentation(save(3))
    image = window(SCENE, 0)
    with pytest.raises(ImageError, match="cannot be compared"):
        Registrar(grey).register(image, colour.describe(image))


@pytest.mark.parametrize("content", [b"", b"no network at all", b"\x08", b"\x3a\x7f\x00", b"\x3b"])
def test_what_is_no_network_is_refused(tmp_path, content):
    (tmp_path / "net.onnx").write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"net\.onnx is no ONNX network"):
        NetworkRepresentation(tmp_path / "net.onnx")


def test_a_network_of_two_images_or_of_two_channels_is_refused(save):
    for path in (save(inputs=2), save(2)):
        with pytest.raises(ConfigurationError, match="grey or a colour"):
            NetworkRepresentation(path)
    with pytest.raises(ConfigurationError, match="cannot read"):
        NetworkRepresentation(path.parent / "missing.onnx")


def test_the_input_of_a_file_is_read_as_the_package_reads_it(save):
    assert input_shape(save(3, ("h", "w")).read_bytes()) == (1, 3, None, None)
    assert input_shape(save(1, (96, 256)).read_bytes()) == (1, 1, 96, 256)


@pytest.mark.skipif(importlib.util.find_spec("onnxruntime") is None, reason="onnxruntime is not installed")
def test_both_runtimes_give_the_same(save, monkeypatch):
    path, image = save(3), window(SCENE, 0)
    one = NetworkRepresentation(path).describe(image).values
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert np.allclose(one, NetworkRepresentation(path).describe(image).values, atol=1e-4)
