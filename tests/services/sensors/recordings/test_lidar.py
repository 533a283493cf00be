"""Recordings of a lidar: every layout, and a sentence for what is wrong with one."""

import json
import struct

import numpy as np
import pytest

from common import geometry
from services.sensors.recordings import RecordingError, is_lidar_recording, open_lidar_recording
from services.sensors.recordings.ouster import PROFILES, Capture, describe, read_sensor

RNG = np.random.default_rng(0)
POINTS = RNG.normal(size=(500, 3)) * 10
INTENSITY = RNG.integers(0, 255, 500)


@pytest.fixture
def archives(tmp_path):
    """A folder of three archives of points."""
    (tmp_path / "drive" / "scans").mkdir(parents=True)
    for i in range(3):
        quanta = np.rint((POINTS + i) / 0.0025).astype(np.int16)
        np.savez(tmp_path / "drive" / "scans" / f"{i:06d}.npz", xyz_q=quanta, intensity=INTENSITY.astype(np.uint8))
    return tmp_path / "drive"


@pytest.fixture
def kitti(tmp_path):
    """KITTI odometry's layout, with poses of camera 0."""
    folder = tmp_path / "sequences" / "07"
    (folder / "velodyne").mkdir(parents=True)
    for i in range(3):
        np.column_stack([POINTS, INTENSITY / 255]).astype("<f4").tofile(folder / "velodyne" / f"{i:06d}.bin")
    (folder / "times.txt").write_text("0.0\n0.1\n0.25\n")
    # Camera: z forward, x right, y down; 0.3 m before the lidar.
    (folder / "calib.txt").write_text("P0: " + "1 " * 12 + "\nTr: 0 -1 0 0 0 0 -1 0 1 0 0 -0.3\n")
    (tmp_path / "poses").mkdir()
    rows = [f"1 0 0 0 0 1 0 0 0 0 1 {i}" for i in range(3)]
    (tmp_path / "poses" / "07.txt").write_text("\n".join(rows))
    return folder


def test_archives_are_read_in_order(archives):
    recording = open_lidar_recording(archives)
    assert is_lidar_recording(archives)
    assert (recording.name, len(recording), recording.poses_truth) == ("drive", 3, None)
    assert recording.stamps_ns.tolist() == [0, 100_000_000, 200_000_000]
    scans = list(recording)
    np.testing.assert_allclose(scans[2].points, POINTS + 2, atol=0.00126)
    assert np.array_equal(scans[2].intensity, INTENSITY)
    assert scans[1].stamp_ns == 100_000_000
    assert scans[0].offsets is None


def test_a_slice_is_a_drive(archives):
    rows = [f"1 0 0 {i} 0 1 0 0 0 0 1 0" for i in (1, 2, 3)]
    (archives / "poses_other_pseudo_gt.txt").write_text("\n".join(rows))
    part = open_lidar_recording(archives).select(slice(0, None, 2))
    assert part.truth == "pseudo truth"
    assert part.poses_truth[:, 0, 3].tolist() == [1, 3]
    assert part[1].stamp_ns == 200_000_000
    np.testing.assert_allclose(part[1].points, POINTS + 2, atol=0.00126)


def test_kittis_poses_are_brought_to_the_lidar(kitti):
    recording = open_lidar_recording(kitti)
    assert recording.truth == "truth"
    assert recording.stamps_ns.tolist() == [0, 100_000_000, 250_000_000]
    # The camera moves along its z, the lidar along its x.
    np.testing.assert_allclose(recording.poses_truth[2], geometry.transform(np.eye(3), [2.0, 0.0, 0.0]), atol=1e-12)
    np.testing.assert_allclose(recording[1].points, POINTS, rtol=1e-6)
    np.testing.assert_allclose(recording[1].intensity, INTENSITY / 255, rtol=1e-6)


@pytest.mark.parametrize("cut", [0, 1, 100])
def test_a_truncated_bin_is_named(kitti, cut):
    file = kitti / "velodyne" / "000001.bin"
    file.write_bytes(file.read_bytes()[: -17 if cut else 0] if cut != 1 else file.read_bytes()[:-1])
    with pytest.raises(RecordingError, match=r"000001.bin is truncated"):
        open_lidar_recording(kitti)[1]


def _archive(**arrays):
    return lambda file: np.savez(file, **arrays)


XYZ, LEVELS = np.ones((4, 16, 3), np.float32), np.ones((4, 16), np.uint8)


@pytest.mark.parametrize(
    ("write", "sentence"),
    [
        (lambda file: file.write_bytes(file.read_bytes()[:300]), "truncated"),
        (lambda file: file.write_bytes(b""), "truncated"),
        (lambda file: file.write_text("no archive"), "no numpy archive"),
        (_archive(xyz_q=np.zeros((5, 3), np.int16)), "no intensity"),
        (_archive(xyz_q=np.zeros((5, 3), np.int16), intensity=np.zeros(4)), r"\(4,\) intensities for \(5,\)"),
        (_archive(xyz_q=np.zeros((5, 2), np.int16), intensity=np.zeros(5)), "xyz_q"),
        (_archive(xyz_q=np.array(["a"])), "xyz_q"),
        (_archive(xyz_q=np.array([{}], dtype=object)), "truncated|archive"),
        (_archive(cloud=np.zeros(3)), "cloud"),
        (_archive(XYZ=XYZ), "no intensity"),
        (_archive(XYZ=XYZ, REFLECTIVITY=LEVELS[:2]), "intensities"),
        (_archive(XYZ=XYZ, REFLECTIVITY=LEVELS, RANGE=LEVELS[:, :3]), "ranges"),
        (_archive(XYZ=XYZ, REFLECTIVITY=LEVELS, timestamp=np.zeros(3)), "times"),
    ],
)
def test_a_bad_archive_is_named(archives, write, sentence):
    write(archives / "scans" / "000001.npz")
    with pytest.raises(RecordingError, match=sentence) as error:
        open_lidar_recording(archives)[1]
    assert "000001.npz" in str(error.value)


def test_a_missing_scan_an_empty_folder_and_bad_poses_are_named(archives, tmp_path):
    (archives / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    with pytest.raises(RecordingError, match="1 rows for 3 files"):
        open_lidar_recording(archives)
    (archives / "scans" / "000001.npz").rename(archives / "scans" / "000007.npz")
    with pytest.raises(RecordingError, match="evenly"):
        open_lidar_recording(archives)
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match="no scans"):
        open_lidar_recording(tmp_path / "empty")
    with pytest.raises(RecordingError, match="nowhere"):
        open_lidar_recording(tmp_path / "nowhere")


def test_an_organised_archive_has_its_columns_times(tmp_path):
    times = np.array([0, 5, 10, 20], dtype=np.uint64) * 1_000_000 + np.uint64(7_000_000_000)
    np.savez(
        tmp_path / "a_0.npz",
        XYZ=np.ones((3, 4, 3), np.float32),
        RANGE=np.array([[1, 0, 1, 1]] * 3),
        REFLECTIVITY=np.ones((3, 4), np.uint8),
        timestamp=times,
    )
    scan = open_lidar_recording(tmp_path)[0]
    assert scan.points.shape == (3, 4, 3)
    assert not scan.points[:, 1].any()
    assert scan.stamp_ns == 7_020_000_000
    np.testing.assert_allclose(scan.offsets[1], [-0.02, -0.015, -0.01, 0.0], atol=1e-7)
    assert scan.reflectivity


# --- Ouster ----------------------------------------------------------------------------------------------------------

BEAMS, COLUMNS, PER_PACKET = 4, 32, 16


def description(profile):
    return {
        "beam_altitude_angles": [10.0, 0.0, -10.0, -20.0],
        "beam_azimuth_angles": [0.0] * BEAMS,
        "lidar_origin_to_beam_origin_mm": 0.0,
        "lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 50, 0, 0, 0, 1],
        "udp_port_lidar": 7502,
        "data_format": {
            "columns_per_frame": COLUMNS,
            "columns_per_packet": PER_PACKET,
            "pixel_shift_by_row": [0, 1, 0, 0],
            "pixels_per_column": BEAMS,
            "udp_profile_lidar": profile,
        },
    }


def _packet(profile, frame, first):
    """Columns from ``first`` on: the ranges are a beam's number and its column's, and 1 m; the signal is twice that."""
    p = PROFILES[profile]
    header = bytearray(p.packet_header)
    if p.frame_in_packet:
        struct.pack_into("<H", header, 2, frame)
    body = b""
    for number in range(first, first + PER_PACKET):
        column = bytearray(p.column_header)
        struct.pack_into("<QH", column, 0, 1_000_000_000 + frame * 100_000_000 + number * 1_000_000, number)
        struct.pack_into("<H", column, 10, 1 if p.frame_in_packet else frame)
        for beam in range(BEAMS):
            pixel = bytearray(p.pixel)
            level = round((beam + number + 1) / p.range_unit)
            struct.pack_into("<I" if p.range_bits > 15 else "<H", pixel, 0, level)
            struct.pack_into("<" + {"<u2": "H", "|u1": "B"}[p.intensity[0]], pixel, p.intensity[1], 2 * (beam + number))
            column += pixel
        body += bytes(column) + b"\xff" * p.column_footer
    return bytes(header) + body + bytes(32 if p.packet_header else 0)


def _capture(packets, port=7502, fragment=None):
    """A packet capture of Ethernet, the datagrams in fragments of so many bytes."""
    out = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    for identification, payload in enumerate(packets):
        datagram = struct.pack(">HHHH", 5000, port, 8 + len(payload), 0) + payload
        size = fragment or len(datagram)
        for start in range(0, len(datagram), size):
            part = datagram[start : start + size]
            more = 0x2000 if start + size < len(datagram) else 0
            head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(part), identification, more | start // 8, 64, 17, 0)
            frame = bytes(12) + b"\x08\x00" + head + bytes([10, 0, 0, 1, 10, 0, 0, 2]) + part
            out += struct.pack("<IIII", 0, 0, len(frame), len(frame)) + frame
    return out


def _ouster(folder, profile, **options):
    packets = [_packet(profile, frame, first) for frame in (7, 8) for first in (0, PER_PACKET)]
    (folder / "drive.pcap").write_bytes(_capture(packets, **options))
    (folder / "drive.json").write_text(json.dumps(description(profile)))
    return folder / "drive.pcap"


@pytest.mark.parametrize("profile", sorted(PROFILES))
@pytest.mark.parametrize("fragment", [None, 256])
def test_an_ousters_packets_are_decoded(tmp_path, profile, fragment):
    recording = open_lidar_recording(_ouster(tmp_path, profile, fragment=fragment))
    assert len(recording) == 2
    scan = recording[1]
    assert scan.points.shape == (BEAMS, COLUMNS, 3)
    ranges = np.linalg.norm(scan.points - [0, 0, 0.05], axis=-1)
    np.testing.assert_allclose(ranges[0], np.arange(COLUMNS) + 1, atol=1e-4)
    # The second beam's row is moved by a column.
    np.testing.assert_allclose(ranges[1], np.roll(np.arange(COLUMNS) + 2, 1), atol=1e-4)
    assert np.array_equal(scan.intensity[3], 2 * (np.arange(COLUMNS) + 3))
    # Column 0 looks along the lidar's x, which is the sensor's -x.
    np.testing.assert_allclose(scan.points[1, 1], [-2.0, 0.0, 0.05], atol=1e-5)
    assert scan.stamp_ns == recording.stamps_ns[1] == 1_800_000_000 + 31_000_000
    assert scan.offsets[0, 0] == pytest.approx(-0.031)


def test_a_capture_of_another_port_or_without_description_is_refused(tmp_path):
    file = _ouster(tmp_path, "LEGACY", port=9)
    with pytest.raises(RecordingError, match="no packets"):
        open_lidar_recording(file)
    (tmp_path / "drive.json").unlink()
    with pytest.raises(RecordingError, match=r"drive.json"):
        open_lidar_recording(file)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"beam_altitude_angles": [1.0]}, "beam table"),
        ({"beam_altitude_angles": "x"}, "no description"),
        ({"data_format": {}}, "no description"),
        ({"data_format": {**description("LEGACY")["data_format"], "udp_profile_lidar": "NEW"}}, "profile NEW"),
    ],
)
def test_a_wrong_description_is_refused(tmp_path, change, sentence):
    file = _ouster(tmp_path, "LEGACY")
    (tmp_path / "drive.json").write_text(json.dumps({**description("LEGACY"), **change}))
    with pytest.raises(RecordingError, match=sentence):
        open_lidar_recording(file)


@pytest.mark.parametrize(
    ("content", "sentence"), [(b"", "empty"), (b"x" * 200, "no packet capture"), (None, "truncated")]
)
def test_a_bad_capture_is_refused(tmp_path, content, sentence):
    file = _ouster(tmp_path, "LEGACY")
    file.write_bytes(file.read_bytes()[:-40] if content is None else content)
    with pytest.raises(RecordingError, match=sentence):
        open_lidar_recording(file)


def test_several_captures_must_be_told_apart(tmp_path):
    _ouster(tmp_path, "LEGACY")
    (tmp_path / "other.pcap").write_bytes(b"")
    with pytest.raises(RecordingError, match="2 captures"):
        open_lidar_recording(tmp_path)


def test_the_ousters_samples_are_read_as_its_own_library_reads_them(data_dir):
    folder = data_dir / "ouster_samples"
    file = folder / "OS-1-128_v2.3.0_1024x10_lb_n3.pcap"
    capture = Capture(file, read_sensor(describe(file)))
    assert len(capture) == 3
    for i in range(3):
        with np.load(folder / f"os1_128_scan_{i}.npz") as theirs:
            seen = theirs["RANGE"] > 0
            scan = capture[i]
            np.testing.assert_allclose(scan.points[seen], theirs["XYZ"][seen], atol=2e-5)
            assert not scan.points[~seen].any()
            assert np.array_equal(scan.intensity, theirs["REFLECTIVITY"])
            assert scan.stamp_ns == theirs["timestamp"].max()
