"""The implementation on arrays, which a GPU runs, on the processor: it finds what the compiled loops find."""

import importlib.util
from types import SimpleNamespace

import numpy as np
import pytest

from services.estimator.surf import SurfError, SurfSettings, arrays, detect_and_describe, extraction
from services.estimator.surf.arrays import device
from services.estimator.surf.frame import prepare
from tests.services.estimator.surf.pictures import photograph, texture


def _strict():
    """The array API standard and nothing else: what runs here runs on every library that keeps to it."""
    xp = pytest.importorskip("array_api_strict")
    return arrays.Device(xp, xp.Device("CPU_DEVICE"), np.asarray)


def _torch():
    pytest.importorskip("torch", reason="PyTorch is not installed")
    xp = pytest.importorskip("array_api_compat.torch")
    return arrays.Device(xp, xp.device("cpu"), lambda array: np.asarray(array.cpu()))


DEVICES = {"numpy": arrays.numpy_device, "strict": _strict, "torch": _torch}


def _assert_same(image, settings, opened, *, wrap=False, mask=None):
    frame = prepare(image, settings, mask, wrap=wrap)
    expected, found = extraction.extract(frame), arrays.extract(frame, opened)
    assert len(expected) > 50
    assert len(found) == len(expected)
    np.testing.assert_allclose(found.points, expected.points, atol=1e-3)
    np.testing.assert_allclose(found.scales, expected.scales, rtol=1e-4)
    np.testing.assert_allclose(found.responses, expected.responses, rtol=1e-4)
    np.testing.assert_array_equal(found.laplacians, expected.laplacians)
    np.testing.assert_allclose(found.angles, expected.angles, atol=1e-4)
    np.testing.assert_allclose(found.descriptors, expected.descriptors, atol=1e-4)
    for name in ("points", "scales", "angles", "laplacians", "responses", "descriptors"):
        assert getattr(found, name).dtype == getattr(expected, name).dtype


@pytest.mark.parametrize("opened", DEVICES)
@pytest.mark.parametrize("wrap", [False, True])
def test_the_same_features_on_a_texture(opened, wrap):
    _assert_same(texture(1, (150, 200)), SurfSettings(), DEVICES[opened](), wrap=wrap)


@pytest.mark.parametrize("opened", DEVICES)
def test_the_same_features_on_a_photograph(opened):
    mask = np.ones((600, 512), np.uint8)
    mask[:, :100] = 0
    _assert_same(photograph(), SurfSettings(cell=40, max_features=400), DEVICES[opened](), mask=mask)


@pytest.mark.parametrize("settings", [SurfSettings(upright=True), SurfSettings(layers=5, octaves=2)])
def test_the_same_features_by_other_settings(settings):
    _assert_same(texture(2, (120, 300)), settings, arrays.numpy_device())


def test_the_same_features_on_noise():
    noise = np.random.default_rng(3).integers(0, 256, (90, 130), dtype=np.uint8)
    _assert_same(noise, SurfSettings(margin=0.0), arrays.numpy_device())


def test_no_blobs_no_features():
    frame = prepare(np.full((60, 60), 9, np.uint8), SurfSettings(), None, wrap=False)
    assert len(arrays.extract(frame, arrays.numpy_device())) == 0


def test_without_a_gpu_the_switch_says_so_in_a_sentence(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(SurfError, match="no GPU for SURF"):
        detect_and_describe(texture(1), SurfSettings(device="gpu"))


def test_with_a_gpu_the_switch_uses_it(monkeypatch):
    monkeypatch.setattr(arrays, "find_gpu", arrays.numpy_device)
    image = texture(1, (100, 120))
    found, expected = detect_and_describe(image, SurfSettings(device="gpu")), detect_and_describe(image)
    np.testing.assert_allclose(found.descriptors, expected.descriptors, atol=1e-4)


def test_a_library_without_a_gpu_is_passed_over(monkeypatch):
    blind = SimpleNamespace(cuda=SimpleNamespace(is_available=lambda: False))
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object())
    monkeypatch.setattr(device.importlib, "import_module", lambda _: blind)
    with pytest.raises(SurfError, match="no GPU for SURF"):
        device.find_gpu()
