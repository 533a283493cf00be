"""Derived objects come back as they were, and whatever else is stored in their place is made again, never believed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages import EnvironmentModel, EnvironmentSpectrum
from services.fleet import stored
from services.fleet.catalog import SharedMap
from services.fleet.feedback import Feedback
from services.fleet.groups import Along, Kind

KIND = Kind("small", 2, 3, 16, 5333)
IMAGES = Along(KIND, np.arange(96, dtype=np.int8).reshape(1, 2, 3, 16), 0.0625)
ROW = stored.Row(KIND, ["a", "b"], np.array([0.5, 1.0]), 7)
MAPS = [SharedMap("a", "p", "q", 1, 2.0, 3, "stereo", 4, 5), SharedMap("b", None, None, 1, 2.0, 3, "lidar", 4)]
MODEL = EnvironmentModel(environment="yard", stamp=1, revision=2, maps=3, reason="why")

SPECTRUM = EnvironmentSpectrum(
    environment="yard", revision=2, frequencies=np.array([0.1, 0.2]), power=np.array([0.0, 0.5]), levels=[(0.01, 0.3)]
)

UNPACK = [
    stored.unpack_images, stored.unpack_row, stored.unpack_catalog, stored.unpack_feedback, stored.unpack_model,
    stored.unpack_spectrum,
]  # fmt: skip
PACKED = [
    stored.pack_images(IMAGES),
    stored.pack_row(ROW),
    stored.pack_catalog(MAPS),
    stored.pack_feedback(Feedback({"k"}, {"a": np.ones((4, 24))})),
    stored.pack_model(MODEL, "digest"),
    stored.pack_spectrum(SPECTRUM),
]


def test_everything_comes_back():
    images, row, maps, feedback, (model, made_of), spectrum = (f(b) for f, b in zip(UNPACK, PACKED, strict=True))
    assert (images.kind, images.values.tolist(), images.cell_height) == (KIND, IMAGES.values.tolist(), 0.0625)
    assert (row.kind, row.names, row.values.tolist(), row.made) == (KIND, ["a", "b"], [0.5, 1.0], 7)
    assert maps == MAPS
    assert (feedback.counted, feedback.sums["a"].sum()) == ({"k"}, 96.0)
    assert (model, made_of) == (MODEL, "digest")
    assert (spectrum.revision, spectrum.levels) == (2, [(0.01, 0.3)])
    assert (spectrum.frequencies.tolist(), spectrum.power.tolist()) == ([0.1, 0.2], [0.0, 0.5])


@pytest.mark.parametrize("index", range(len(PACKED)))
def test_another_object_in_its_place_or_a_torn_one_is_stale(index):
    for other, content in enumerate(PACKED):
        if other != index:
            with pytest.raises(stored.StaleObject):
                UNPACK[index](content)
    for length in range(0, len(PACKED[index]) - 1, 7):
        with pytest.raises(stored.StaleObject):
            UNPACK[index](PACKED[index][:length])


@pytest.mark.parametrize("unpack", UNPACK)
@given(st.binary(max_size=200))
def test_any_bytes_are_stale_and_nothing_worse(unpack, content):
    with pytest.raises(stored.StaleObject):
        unpack(content)
