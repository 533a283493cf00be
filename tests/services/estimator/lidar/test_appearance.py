import numpy as np

from services.estimator.lidar.appearance import as_bits


def _unit(values):
    return (values / np.linalg.norm(values, axis=1, keepdims=True)).astype(np.float32)


def test_differing_bits_tell_the_angle_between_descriptors():
    rng = np.random.default_rng(0)
    a = _unit(rng.normal(size=(2000, 64)))
    across = rng.normal(size=(2000, 64))
    across = _unit(across - (across * a).sum(axis=1, keepdims=True) * a)
    for degrees in (10.0, 30.0, 60.0, 90.0):
        angle = np.radians(degrees)
        b = np.cos(angle) * a + np.sin(angle) * across
        differing = np.bitwise_count(as_bits(a) ^ as_bits(b.astype(np.float32))).sum(axis=1)
        assert abs(differing.mean() / 256.0 - angle / np.pi) < 0.01


def test_a_descriptor_is_256_bits_and_the_same_in_every_process():
    bits = as_bits(_unit(np.arange(128.0).reshape(2, 64) - 40.0))
    assert bits.shape == (2, 32)
    assert bits.dtype == np.uint8
    assert bits[0, :4].tolist() == as_bits(_unit(np.arange(64.0)[None] - 40.0))[0, :4].tolist()
