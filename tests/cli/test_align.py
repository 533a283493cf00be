"""``vtr align``: one pair, a table of pairs, and a sentence for whatever is wrong with either."""

import csv
import json

import cv2
import numpy as np
import pytest

from tests.common.registration.scenes import panorama, window

SHIFT = 48


@pytest.fixture
def folder(tmp_path):
    """Images of one scene: in ``live.png`` it lies 48 pixels further right than in ``stored.png``."""
    scene, images = panorama(), tmp_path / "images"
    images.mkdir()
    cv2.imwrite(str(images / "stored.png"), window(scene, 400))
    cv2.imwrite(str(images / "live.png"), cv2.cvtColor(window(scene, 400 - SHIFT), cv2.COLOR_GRAY2BGR))
    return images


def table(folder, *rows, header="live,stored"):
    path = folder / "pairs.csv"
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def test_one_pair_is_told_as_json_and_to_a_reader(vtr, folder):
    result = vtr("align", folder / "live.png", folder / "stored.png", "--json")
    figures = json.loads(result.out)
    assert result.code == 0
    assert abs(figures["shift_px"] - SHIFT) < 1
    assert 0.8 < figures["score"] <= 1
    assert 0 < figures["sigma_px"] < 10
    assert 0 < figures["confidence"] <= 1
    text = vtr("align", folder / "live.png", folder / "stored.png").out
    assert "further right in the live image" in text


def test_a_table_of_pairs_becomes_a_table_of_shifts(vtr, folder, tmp_path):
    pairs = table(folder, "live.png,stored.png", f"{folder}/stored.png,images/live.png", "live.png,live.png")
    result = vtr("align", "--pairs", pairs, "-o", tmp_path / "out.csv")
    assert result.code == 0
    rows = list(csv.DictReader((tmp_path / "out.csv").open(encoding="utf-8")))
    assert list(rows[0]) == ["live", "stored", "shift_px", "score"]
    assert [row["live"] for row in rows] == ["live.png", f"{folder}/stored.png", "live.png"]
    assert np.allclose([float(row["shift_px"]) for row in rows], [SHIFT, -SHIFT, 0], atol=1)


def test_a_table_without_output_is_printed(vtr, folder):
    pairs = table(folder, '"stored.png", live.png,12', header="\ufeffstored, live ,remark")
    assert vtr("align", "--pairs", pairs).out.splitlines()[0] == "live,stored,shift_px,score"
    (pair,) = json.loads(vtr("align", "--pairs", pairs, "--json").out)["pairs"]
    assert abs(pair["shift_px"] - SHIFT) < 1


@pytest.mark.parametrize(
    ("rows", "header", "words"),
    [
        (["live.png,stored.png", "live.png,none.png"], "live,stored", ["line 3", "none.png"]),
        (["live.png,"], "live,stored", ["line 2", "no stored image"]),
        (["live.png"], "live,stored", ["line 2", "no stored image"]),
        (["live.png,pairs.csv"], "live,stored", ["line 2", "cannot be decoded"]),
        (["live.png,wide.png"], "live,stored", ["line 2", "differ in shape"]),
        (["live.png,cut.png"], "live,stored", ["line 2", "truncated"]),
        (["a,b"], "now,stored", ["no column live"]),
        (["a,b"], "x,y", ["no column live", "no column stored"]),
        ([], "live,stored", ["no pairs"]),
        ([], "", ["no column"]),
    ],
)
def test_what_is_wrong_with_a_table_is_said_with_its_line_and_nothing_written(
    vtr, folder, tmp_path, rows, header, words
):
    cv2.imwrite(str(folder / "wide.png"), np.zeros((40, 400), np.uint8))
    (folder / "cut.png").write_bytes((folder / "live.png").read_bytes()[:500])
    result = vtr("align", "--pairs", table(folder, *rows, header=header), "-o", tmp_path / "out.csv")
    assert result.code == 1
    assert all(word in result.sentence for word in words)
    assert not (tmp_path / "out.csv").exists()


def test_a_table_that_is_none_is_refused(vtr, folder, tmp_path):
    assert "nowhere.csv" in vtr("align", "--pairs", "nowhere.csv").sentence
    assert "no text" in vtr("align", "--pairs", folder / "live.png").sentence
    assert "folder" in vtr("align", "--pairs", table(folder, "live.png,live.png"), "-o", tmp_path).sentence


def test_what_is_asked_for_must_be_one_thing(vtr, folder):
    live, stored = folder / "live.png", folder / "stored.png"
    assert "two images" in vtr("align").sentence
    assert "two images" in vtr("align", live).sentence
    assert "not both" in vtr("align", live, stored, "--pairs", table(folder)).sentence
    assert "--pairs" in vtr("align", live, stored, "-o", "out.csv").sentence
    assert "--model" in vtr("align", live, stored, "--model-width", 64).sentence


def test_an_image_or_a_model_that_cannot_be_read_is_named(vtr, folder):
    live = folder / "live.png"
    assert "nowhere.png" in vtr("align", live, "nowhere.png").sentence
    assert "net.onnx" in vtr("align", live, live, "--model", "net.onnx").sentence
    assert "live.png" in vtr("align", live, live, "--model", live).sentence
