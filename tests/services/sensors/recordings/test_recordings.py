import cv2
import numpy as np
import pytest

from services.sensors.recordings import RecordingError, open_recording

LEFT = "700 0 60 0 0 700 40 0 0 0 1 0"
RIGHT = "700 0 60 -350 0 700 40 0 0 0 1 0"
SIZE = (80, 120)


def _write_images(folder, numbers, depth=np.uint8, channels=1, size=SIZE):
    folder.mkdir(parents=True, exist_ok=True)
    for n in numbers:
        shape = size if channels == 1 else (*size, channels)
        image = np.full(shape, 10 + n, np.uint8).astype(depth) * (257 if depth == np.uint16 else 1)
        if channels == 3:
            image[..., 2] += 50
        cv2.imwrite(str(folder / f"{n:06d}.png"), image)


def _make(folder, count=4, calib=f"{LEFT}\n{RIGHT}\n", **options):
    for side in ("left", "right"):
        _write_images(folder / side, range(count), **options)
    (folder / "calib.txt").write_text(calib)
    return folder


def _poses(count, step=1.0):
    return "\n".join(f"1 0 0 0 0 1 0 0 0 0 1 {i * step}" for i in range(count))


def test_pairs_come_in_order_with_camera_stamps_and_truth(tmp_path):
    folder = _make(tmp_path / "drive")
    (folder / "poses.txt").write_text(_poses(4))
    recording = open_recording(folder)
    assert (len(recording), recording.name) == (4, "drive")
    camera = recording.camera
    assert (camera.width, camera.height, camera.fx, camera.cx, camera.cy) == (120, 80, 700.0, 60.0, 40.0)
    assert camera.baseline == pytest.approx(0.5)
    np.testing.assert_allclose(camera.T_vehicle_camera[:3, 2], [1, 0, 0], err_msg="the camera looks along the vehicle")
    pairs = list(recording)
    assert [p.stamp_ns for p in pairs] == [0, 100_000_000, 200_000_000, 300_000_000]
    assert [int(p.left[0, 0]) for p in pairs] == [10, 11, 12, 13]
    np.testing.assert_allclose(recording.poses_truth[:, 2, 3], [0, 1, 2, 3])


def test_times_are_the_stamps_and_every_second_pair_is_a_drive(tmp_path):
    folder = _make(tmp_path)
    (folder / "times.txt").write_text("0.0\n0.11\n0.2\n0.35\n")
    (folder / "poses.txt").write_text(_poses(4))
    odd = open_recording(folder).every(2, 1)
    assert odd.stamps_ns.tolist() == [110_000_000, 350_000_000]
    assert odd.poses_truth[:, 2, 3].tolist() == [1, 3]
    assert [int(p.left[0, 0]) for p in odd] == [11, 13]


def test_a_thinned_folder_finds_its_rows_by_the_images_numbers(tmp_path):
    folder = _make(tmp_path, count=6)
    (folder / "poses.txt").write_text(_poses(6))
    for side in ("left", "right"):
        for n in (1, 3, 5):
            (folder / side / f"{n:06d}.png").unlink()
    assert open_recording(folder).poses_truth[:, 2, 3].tolist() == [0, 2, 4]


def test_kittis_own_layout(tmp_path):
    sequence = tmp_path / "sequences" / "07"
    for camera in range(4):
        _write_images(sequence / f"image_{camera}", range(3), channels=1 if camera < 2 else 3)
    rows = {i: f"P{i}: 700 0 60 {-700 * t} 0 700 40 0 0 0 1 0" for i, t in enumerate((0.0, 0.5, -0.06, 0.47))}
    (sequence / "calib.txt").write_text("\n".join(rows.values()) + "\nTr: " + LEFT)
    (sequence / "times.txt").write_text("0\n0.1\n0.2\n")
    (tmp_path / "poses").mkdir()
    (tmp_path / "poses" / "07.txt").write_text(_poses(3))
    grey = open_recording(sequence)
    assert grey[0].left.ndim == 2
    assert grey.camera.baseline == pytest.approx(0.5)
    np.testing.assert_allclose(grey.poses_truth[2, :3, 3], [0, 0, 2])
    for camera in range(2):
        for file in (sequence / f"image_{camera}").iterdir():
            file.unlink()
        (sequence / f"image_{camera}").rmdir()
    colour = open_recording(sequence)
    assert colour.camera.baseline == pytest.approx(0.53)
    np.testing.assert_array_equal(colour[1].left[0, 0], [61, 11, 11], err_msg="red comes first")


def test_truth_of_camera_0_is_brought_to_the_left_camera(tmp_path):
    rows = (f"P{i}: 700 0 60 {-700 * t} 0 700 40 0 0 0 1 0" for i, t in enumerate((0.0, 0.5, -0.1, 0.4)))
    folder = _make(tmp_path, count=2, calib="\n".join(rows), channels=3)
    (folder / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n0 0 1 0 0 1 0 0 -1 0 0 0")
    # Camera 0 turns on the spot by a quarter; the left camera, 0.1 m beside it, moves on a circle.
    truth = open_recording(folder).poses_truth
    np.testing.assert_allclose(truth[0], np.eye(4), atol=1e-12)
    np.testing.assert_allclose(truth[1, :3, 3], [0.1, 0, 0.1], atol=1e-9)


def test_sixteen_bits_and_alpha_are_reduced(tmp_path):
    assert open_recording(_make(tmp_path / "a", depth=np.uint16))[2].left[0, 0] == 12
    assert open_recording(_make(tmp_path / "b", channels=4))[0].left.shape == (*SIZE, 3)


def _remove(name):
    return lambda folder: (folder / name).unlink()


def _write(name, text):
    return lambda folder: (folder / name).write_text(text)


def _truncate(folder):
    file = folder / "right" / "000000.png"
    (folder / "left" / "000000.png").write_bytes(file.read_bytes()[:-30])


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (_remove("calib.txt"), ["calib.txt", "restore"]),
        (_remove("left/000002.png"), ["000001.png", "000003.png", "missing"]),
        (_remove("right/000003.png"), ["4 images", "3", "000003"]),
        (_truncate, ["000000.png", "truncated", "copy it again"]),
        (_write("left/000000.png", "no image"), ["000000.png", "decoded"]),
        (_write("calib.txt", f"{LEFT}\n"), ["calib.txt", "right"]),
        (_write("calib.txt", f"{LEFT}\n{LEFT}\n"), ["baseline"]),
        (_write("calib.txt", f"{RIGHT}\n{LEFT}\n"), ["baseline"]),
        (_write("calib.txt", f"{LEFT}\n1 2 3\n"), ["row 2", "12 numbers", "3"]),
        (_write("calib.txt", f"{LEFT}\n{RIGHT.replace('-350', 'nan')}\n"), ["row 2", "finite"]),
        (_write("calib.txt", f"{LEFT}\n{RIGHT.replace('700', 'x')}\n"), ["row 2", "not a number"]),
        (_write("calib.txt", f"{LEFT}\n{RIGHT.replace('700', '650')}\n"), ["rectified"]),
        (_write("calib.txt", f"{LEFT.replace('700', '0')}\n{RIGHT}\n"), ["focal length"]),
        (_write("calib.txt", ""), ["calib.txt", "left"]),
        (_write("poses.txt", _poses(3)), ["poses.txt", "3 rows", "4 files"]),
        (_write("poses.txt", "2 0 0 0 0 1 0 0 0 0 1 0\n" * 4), ["poses.txt", "rigid"]),
        (_write("times.txt", "0\n0.1\n0.1\n0.3\n"), ["times.txt", "increase", "row 2"]),
        (_write("times.txt", "0\n0.1\n"), ["times.txt", "2 rows"]),
    ],
)
def test_each_damage_is_one_clear_sentence(tmp_path, damage, words):
    folder = _make(tmp_path)
    damage(folder)
    with pytest.raises(RecordingError) as error:
        open_recording(folder)
    sentence = str(error.value)
    assert "\n" not in sentence
    for word in words:
        assert word in sentence


def test_damage_in_the_middle_shows_when_the_pair_is_read(tmp_path):
    folder = _make(tmp_path)
    recording = open_recording(folder)
    (folder / "right" / "000001.png").write_bytes((folder / "right" / "000001.png").read_bytes()[:40])
    _write_images(folder / "left", [2], size=(40, 40))
    (folder / "left" / "000003.png").unlink()
    assert recording[0].left.shape == SIZE
    for index, word in ((1, "truncated"), (2, "40x40"), (3, "cannot read")):
        with pytest.raises(RecordingError, match=word):
            recording[index]


def test_a_folder_that_is_none_or_holds_no_pairs(tmp_path):
    with pytest.raises(RecordingError, match="no folder"):
        open_recording(tmp_path / "nowhere")
    with pytest.raises(RecordingError, match="left/"):
        open_recording(tmp_path)
    (tmp_path / "left").mkdir()
    with pytest.raises(RecordingError, match="holds no images"):
        open_recording(tmp_path)


def test_the_real_folders(data_dir):
    kitti06 = open_recording(data_dir / "kitti06_gray_stereo")
    assert (len(kitti06), kitti06.camera.width, kitti06[50].right.ndim) == (51, 1226, 2)
    kitti02 = open_recording(data_dir / "kitti02_colour_stereo")
    assert (len(kitti02), kitti02.camera.height, kitti02[19].right.ndim) == (20, 376, 3)
    assert kitti02.camera.baseline == pytest.approx(0.5333, abs=1e-3)
    assert kitti02.stamps_ns[1] == 103_611_700
