"""Pictures of localization: what is drawn where, and that empty and perfect drives are drawn too."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from cli.errors import CommandError
from cli.views.localization_plots import (
    Row,
    draw_dead_reckoning,
    draw_one_vs_all,
    draw_one_vs_one,
    plot_both,
    plot_dead_reckoning,
)
from services.estimator.coverage import measure

DISTANCE = np.arange(20.0)
EARLY, LATE, NEVER = DISTANCE < 12, DISTANCE > 8, DISTANCE < 0


@pytest.fixture
def axes():
    return Figure().add_subplot()


def test_each_system_has_a_row_of_points_where_it_localized(axes):
    draw_one_vs_one(axes, DISTANCE, {"baseline": EARLY, "invariant": LATE, "combined": EARLY | LATE})
    points = [line.get_xdata().tolist() for line in axes.lines]
    assert points[::2] == [DISTANCE[EARLY].tolist(), DISTANCE[LATE].tolist(), DISTANCE.tolist()]
    assert points[1::2] == [DISTANCE[~EARLY].tolist(), DISTANCE[~LATE].tolist(), []]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["Baseline", "Invariant", "Combined"]
    assert [text.get_text() for text in axes.texts] == ["60.0 %", "55.0 %", "100.0 %"]


def test_colours_tell_which_stream_localized(axes):
    draw_one_vs_all(axes, DISTANCE, [Row("07:00", EARLY, LATE), Row("17:00", NEVER, NEVER)])
    legend = {text.get_text(): patch.get_facecolor() for text, patch in zip(
        axes.get_legend().get_texts(), axes.get_legend().get_patches(), strict=True)}  # fmt: skip
    mesh = axes.collections[0]
    shown = [to_hex(mesh.cmap(mesh.norm(kind))) for kind in mesh.get_array().reshape(2, -1)[0]]
    expected = ["only baseline"] * 9 + ["both"] * 3 + ["only invariant"] * 8
    assert shown == [to_hex(legend[name]) for name in expected]
    assert (mesh.get_array().reshape(2, -1)[1] == 0).all()


def test_the_curves_are_the_probabilities(axes):
    systems = {"baseline": measure(EARLY, DISTANCE), "combined": measure(EARLY | LATE, DISTANCE)}
    draw_dead_reckoning(axes, systems)
    baseline, combined = (line for line in axes.lines if len(line.get_xdata()) > 2)
    x, y = baseline.get_data()
    assert y[x < 7.0].tolist() == [1.0] * (x < 7.0).sum()
    assert not y[x > 7.0].any()
    assert not combined.get_ydata().any()


def test_drives_without_a_loss_or_without_a_success_are_drawn(tmp_path):
    for name, mask in (("never", NEVER), ("always", ~NEVER)):
        systems = {"plain": measure(mask, DISTANCE)}
        plot_both(tmp_path / f"{name}.png", name, DISTANCE, {"plain": mask}, systems)
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000


def test_a_picture_that_cannot_be_written_is_a_sentence(tmp_path):
    with pytest.raises(CommandError, match="cannot write"):
        plot_dead_reckoning(tmp_path / "nowhere" / "x.png", "", {"plain": measure(EARLY, DISTANCE)})
