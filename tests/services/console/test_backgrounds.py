"""Images and tiles under the map."""

import cv2
import numpy as np
import pytest

from services.console.errors import BadArguments
from services.console.robot.backgrounds import Backgrounds

PNG = cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))[1].tobytes()
LIES = {"x": 1.0, "y": -2.0, "rotation": 0.3, "scale": 0.05, "opacity": 0.5}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "secret.png").write_bytes(PNG)
    return tmp_path / "backgrounds"


@pytest.fixture
def backgrounds(folder):
    return Backgrounds(folder, folder.parent / "background.json")


def test_an_image_is_uploaded_laid_down_and_still_lies_there_after_a_restart(backgrounds, folder):
    backgrounds.store("site plan.png", PNG)
    backgrounds.align("garden", {"name": "site plan.png", **LIES})
    anew = Backgrounds(folder, folder.parent / "background.json").section("garden")
    assert anew["available"] == [{"name": "site plan.png", "kind": "image"}]
    assert anew["shown"] == {"name": "site plan.png", **LIES}
    assert backgrounds.section("yard")["shown"] is None
    backgrounds.align("garden", None)
    assert backgrounds.section("garden")["shown"] is None


def test_tiles_are_found_with_their_zooms(backgrounds, folder):
    for zoom, x, y in ((3, 4, 2), (4, 8, 4), (4, 9, 5)):
        tile = folder / "air" / str(zoom) / str(x) / f"{y}.png"
        tile.parent.mkdir(parents=True, exist_ok=True)
        tile.write_bytes(PNG)
    (found,) = backgrounds.section("garden")["available"]
    assert found == {"name": "air", "kind": "tiles", "zooms": [3, 4], "x": [8, 9], "y": [4, 5], "suffix": ".png"}
    assert backgrounds.resource("air/4/9/5.png").body == PNG
    assert backgrounds.resource("air/4/9/6.png") is None


@pytest.mark.parametrize(
    "path", ["../secret.png", "a/../../secret.png", "/etc/passwd", "air/4/9/../../../../secret.png", "x.toml", "", "."]
)
def test_nothing_else_is_handed_out(backgrounds, path):
    backgrounds.store("plan.png", PNG)
    assert backgrounds.resource(path) is None


def test_a_link_out_of_the_folder_is_not_followed(backgrounds, folder):
    backgrounds.store("plan.png", PNG)
    (folder / "out.png").symlink_to(folder.parent / "secret.png")
    assert backgrounds.resource("out.png") is None


@pytest.mark.parametrize(
    ("name", "body"), [("plan.svg", PNG), ("../plan.png", PNG), ("plan.png", b"no image"), ("plan.png", b"")]
)
def test_what_is_no_image_is_refused(backgrounds, name, body):
    with pytest.raises(BadArguments):
        backgrounds.store(name, body)


@pytest.mark.parametrize(
    "wrong", [{"scale": "1"}, {"x": float("nan")}, {"rotation": True}, {"name": "nix.png"}, {"y": 1e9}]
)
def test_figures_that_are_none_are_refused(backgrounds, wrong):
    backgrounds.store("plan.png", PNG)
    with pytest.raises(BadArguments):
        backgrounds.align("garden", {"name": "plan.png", **LIES, **wrong})


def test_a_torn_file_is_forgotten(folder):
    file = folder.parent / "background.json"
    for text in ("{", "[]", '{"garden": {"name": "x"}}', '{"garden": 3}'):
        file.write_text(text)
        assert Backgrounds(folder, file).section("garden")["shown"] is None
