"""Of what cameras deliver, sharp pairs of a still board in a new pose are kept."""

import numpy as np
import pytest

from services.sensors.calibration.board import Board
from services.sensors.calibration.choosing import PoseChooser
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.simulation import BOARD, simulated_poses


@pytest.fixture(scope="module")
def looks(renderer):
    """Renders pose number k of the board, moved by some metres to the right."""
    rng = np.random.default_rng(1)
    places = simulated_poses(6, rng)

    def look(k, moved=0.0, **how):
        T = places[k].copy()
        T[0, 3] += moved
        return renderer.pair(T, rng, **how)

    return look


def test_a_still_board_in_a_new_pose_is_kept(looks):
    chooser = PoseChooser(BOARD)
    assert "hold" in chooser.consider(*looks(0))
    assert chooser.consider(*looks(0)) == ""
    assert "move or tilt" in chooser.consider(*looks(0))
    assert "hold" in chooser.consider(*looks(1))
    assert "hold" in chooser.consider(*looks(1, moved=0.005))
    assert chooser.consider(*looks(1, moved=0.005)) == ""
    assert "blurred" in chooser.consider(*looks(2, blur=4.0))
    assert "hold" in chooser.consider(*looks(2))
    assert chooser.consider(*looks(2)) == ""
    assert len(chooser.kept) == 3


def test_it_waits_for_the_board_and_finds_its_dictionary(looks):
    chooser = PoseChooser(Board(7, 5, 0.04, 0.03, "4X4_50"), any_dictionary=True)
    empty = np.full((320, 480), 90, np.uint8)
    assert "show the board" in chooser.consider(empty, empty)
    chooser.consider(*looks(0))
    assert chooser.consider(*looks(0)) == ""


def test_another_board_is_refused_after_a_few_pairs(looks):
    chooser = PoseChooser(Board(5, 7, 0.04, 0.03))
    for _ in range(4):
        assert "show the board" in chooser.consider(*looks(0))
    with pytest.raises(CalibrationError, match="7x5"):
        chooser.consider(*looks(0))
