"""Maps are compared by images along them, and only a new map's row is computed."""

import numpy as np
import pytest

from common.errors import ImageError
from services.fleet.similarity import Comparer, SimilarityMatrix, even_shares, softmax_rows
from services.fleet.spectrum import of_maps
from services.sensors.recordings.images import read_image
from tests.common.registration.scenes import panorama, window


def test_images_are_taken_evenly_with_both_ends():
    assert even_shares(100) == [0, 33, 66, 99]
    assert even_shares(3) == [0, 1, 2]
    assert even_shares(1) == [0]


def test_the_same_place_shifted_is_alike_and_another_place_is_not():
    comparer = Comparer()
    left, right = (comparer.prepare([window(panorama(0), k)]) for k in (0, 20))
    other = comparer.prepare([window(panorama(1), 0)])
    assert comparer.similarity(left, left) == pytest.approx(1.0, abs=1e-3)
    assert comparer.similarity(left, right) > comparer.similarity(left, other) + 0.2
    assert comparer.similarity(left, right) == pytest.approx(comparer.similarity(right, left), abs=1e-3)


def test_maps_of_different_numbers_of_images_are_compared_at_the_same_shares():
    comparer = Comparer()
    places = [window(panorama(k), 0) for k in range(5)]
    long, short = comparer.prepare(places), comparer.prepare([places[0], places[2], places[4]])
    assert comparer.similarity(long, short) == pytest.approx(1.0, abs=1e-3)
    assert comparer.similarity(short, long) == pytest.approx(1.0, abs=1e-3)


def test_a_matrix_grows_by_a_row_and_a_column():
    matrix = SimilarityMatrix().with_row("a", 1.0, np.array([1.0])).with_row("b", 2.0, np.array([0.5, 1.0]))
    assert matrix.names == ("a", "b")
    assert matrix.hours.tolist() == [1.0, 2.0]
    assert matrix.values.tolist() == [[1.0, 0.5], [0.5, 1.0]]


def test_images_of_different_shapes_are_refused():
    comparer = Comparer()
    image = window(panorama(0), 0)
    with pytest.raises(ImageError, match="shape"):
        comparer.similarity(comparer.prepare([image]), comparer.prepare([image[:100]]))


@pytest.mark.parametrize("beta", [0.0, 0.1, 50.0])
def test_the_softmax_is_that_of_equation_3_5(beta):
    values = np.array([[248.6, 217.4, 144.0], [1.0, 2.0, 3.0]])
    rows = softmax_rows(values, beta)
    assert rows.sum(axis=1) == pytest.approx([1.0, 1.0])
    ratio = np.exp(beta * (values[1, 1] - values[1, 0]))
    assert rows[1, 1] / rows[1, 0] == pytest.approx(ratio)


def test_a_webcam_s_images_repeat_by_the_day(data_dir):
    files = sorted((data_dir / "webcam_vegas" / "images").iterdir())[::8]
    hours = [
        np.datetime64(f"{file.stem[:10]}T{file.stem[11:].replace('_', ':')}").astype(float) / 3600 for file in files
    ]
    comparer, matrix, prepared = Comparer(), SimilarityMatrix(), []
    for file, hour in zip(files, hours, strict=True):
        images = comparer.prepare([read_image(file)])
        matrix = matrix.with_row(file.stem, hour, comparer.row(images, prepared))
        prepared.append(images)
    found = of_maps(matrix.hours, matrix.values)
    assert found.periods_hours[0] == pytest.approx(24, rel=0.02)
    assert abs(found.phases[0]) < np.radians(10)
