"""A row at once has the numbers of the comparisons one by one."""

import numpy as np
import pytest

from common.registration import Described, Registrar
from services.fleet.rows import Images, row
from services.fleet.similarity import Comparer
from tests.common.registration.scenes import panorama, window


def stored(place, counts, shift=0):
    """A map's images (as they are stored) of so many places, seen from ``shift`` pixels further."""
    described = [Registrar().prepare(window(panorama(place + k), shift)).described for k in range(counts)]
    return [Described.from_arrays(one.to_arrays()) for one in described], described[0].cell_height


def as_bytes(images):
    return np.stack([one.to_arrays()["values"] for one in images])


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_row_is_what_comparing_one_by_one_gives(count):
    new, cell_height = stored(0, count)
    others = [stored(place, number, 7 * place)[0] for place, number in ((0, 4), (1, 4), (0, 2), (3, 1), (1, 3))]
    packed = [Images.of(as_bytes(images)) for images in others]
    together = Images(np.concatenate([p.values for p in packed]), np.concatenate([p.counts for p in packed]))
    comparer = Comparer()
    expected = comparer.row(comparer.prepare(new), [comparer.prepare(images) for images in others])
    assert row(as_bytes(new), together, cell_height) == pytest.approx(expected[:-1], abs=1e-5)
    assert row(as_bytes(new), Images.of(as_bytes(new)), cell_height) == pytest.approx(expected[-1:], abs=1e-5)


def test_an_image_without_structure_is_like_nothing():
    new, cell_height = stored(0, 1)
    blank = Images.of(np.full_like(as_bytes(new), 5))
    assert row(as_bytes(new), blank, cell_height).tolist() == [0.0]
    assert row(blank.values[0, :1], blank, cell_height).tolist() == [0.0]
