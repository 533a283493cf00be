"""Ouster's recordings: a packet capture and the sensor's description beside it (``.pcap`` and ``.json``).

The packets are decoded here, by Ouster's *Sensor data* manual: ``ouster-sdk`` 1.0 pins psutil, click, flask and rosbags
to versions that no project with newer ones can install beside it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.lidar import LidarScan
from services.sensors.recordings.images import RecordingError
from services.sensors.recordings.pcap import Part, datagrams, open_capture

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Profile:
    """How a packet is laid out: sizes and places in bytes.

    Attributes:
        packet_header, column_header, column_footer: before and after what is repeated.
        pixel: size of a beam's measurement in a column.
        frame_in_packet: whether the frame's number is in the packet's header, at 2, rather than in the column's, at 10.
        range_bits, range_unit: bits of the range and its unit, metres; it begins the pixel.
        intensity: type of the intensity and its place in the pixel.
    """

    packet_header: int
    column_header: int
    column_footer: int
    pixel: int
    frame_in_packet: bool
    range_bits: int
    range_unit: float
    intensity: tuple[str, int]


PROFILES = {
    "LEGACY": Profile(0, 16, 4, 12, False, 20, 0.001, ("<u2", 6)),
    "RNG19_RFL8_SIG16_NIR16": Profile(32, 12, 0, 12, True, 19, 0.001, ("<u2", 6)),
    "RNG19_RFL8_SIG16_NIR16_DUAL": Profile(32, 12, 0, 16, True, 19, 0.001, ("<u2", 8)),
    "RNG15_RFL8_NIR8": Profile(32, 12, 0, 4, True, 15, 0.008, ("|u1", 2)),
}
"""By name. The intensity is the signal; in the low-bandwidth profile, which has none, the reflectivity, already
corrected for the range."""
_CORRECTED = frozenset({"RNG15_RFL8_NIR8"})


@dataclass(frozen=True, slots=True)
class Sensor:
    """What the description says of a sensor.

    Attributes:
        profile: of its packets, by name.
        columns: of a turn; ``packet_columns`` of a packet.
        altitudes, azimuths: (H,) of the beams, radians.
        shifts: (H,) columns by which a beam's row is moved so that a column of the image looks one way.
        origin: distance of the beams' origin from the axis, metres.
        T_sensor_lidar: (4, 4), metres.
        port: that the packets are sent to.
    """

    profile: str
    columns: int
    packet_columns: int
    altitudes: Array
    azimuths: Array
    shifts: NDArray[np.int64]
    origin: float
    T_sensor_lidar: Array
    port: int

    @property
    def beams(self) -> int:
        """How many beams there are."""
        return len(self.altitudes)


def read_sensor(file: Path) -> Sensor:
    """The sensor of a description.

    Raises:
        RecordingError: the file is missing, no description of a sensor, or of one whose packets are not known.
    """
    try:
        known = json.loads(file.read_text(encoding="utf-8"))
        layout = known["data_format"]
        altitudes, azimuths = (
            np.radians(np.array(known[f"beam_{name}_angles"], dtype=np.float64)) for name in ("altitude", "azimuth")
        )
        T = np.array(known["lidar_to_sensor_transform"], dtype=np.float64).reshape(4, 4)
        T[:3, 3] *= 1e-3
        sensor = Sensor(
            profile=str(layout.get("udp_profile_lidar", "LEGACY")),
            columns=int(layout["columns_per_frame"]),
            packet_columns=int(layout["columns_per_packet"]),
            altitudes=altitudes,
            azimuths=azimuths,
            shifts=np.array(layout["pixel_shift_by_row"], dtype=np.int64),
            origin=1e-3 * float(known.get("lidar_origin_to_beam_origin_mm", 0.0)),
            T_sensor_lidar=T,
            port=int(known.get("udp_port_lidar", 7502)),
        )
    except OSError as error:
        raise RecordingError(f"cannot read {file} ({error.strerror}): put the sensor's description there") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise RecordingError(f"{file} is no description of an Ouster sensor ({error!r}): record it anew") from error
    if sensor.profile not in PROFILES:
        raise RecordingError(f"{file} has packets of profile {sensor.profile}: record {', '.join(PROFILES)}")
    beams = {len(altitudes), len(azimuths), len(sensor.shifts), int(layout["pixels_per_column"])}
    if len(beams) > 1 or sensor.beams == 0 or sensor.columns % sensor.packet_columns:
        raise RecordingError(f"{file} has a beam table that does not fit its {layout['pixels_per_column']} beams")
    return sensor


class Capture:
    """The scans of a packet capture, found at once and decoded one by one."""

    def __init__(self, file: Path, sensor: Sensor) -> None:
        """Finds the packets of each turn.

        Raises:
            RecordingError: the capture cannot be read, or holds no packets of this sensor.
        """
        self.file = file
        self.sensor = sensor
        self._bytes = open_capture(file)
        profile = PROFILES[sensor.profile]
        self._column_size = profile.column_header + sensor.beams * profile.pixel + profile.column_footer
        self._turns: list[list[tuple[Part, ...]]] = []
        last = None
        least = profile.packet_header + sensor.packet_columns * self._column_size
        for port, parts in datagrams(self._bytes, file):
            if port != sensor.port or sum(end - start for start, end in parts) < least:
                continue
            place = 2 if profile.frame_in_packet else profile.packet_header + 10
            frame = int(np.frombuffer(self._bytes, "<u2", 1, parts[0][0] + place)[0])
            if frame != last:
                self._turns.append([])
                last = frame
            self._turns[-1].append(parts)
        if not self._turns:
            raise RecordingError(f"{file} holds no packets of the sensor that is described beside it")

    def __len__(self) -> int:
        return len(self._turns)

    def __getitem__(self, index: int) -> LidarScan:
        """Decode one turn; what is missing of it came back from nowhere.

        Raises:
            RecordingError: none of its packets is whole.
        """
        ranges, intensity, times = self._decode(self._turns[index])
        seen = times > 0
        if not seen.any():
            raise RecordingError(f"scan {index} of {self.file} holds no valid column: copy the file again")
        stamp = int(times[seen].max())
        offsets = np.where(seen, (times - stamp) * 1e-9, 0.0)
        points = self._points(ranges)
        rows, columns = np.indices(ranges.shape)
        source = rows, (columns - self.sensor.shifts[:, None]) % self.sensor.columns
        return LidarScan(
            stamp_ns=stamp,
            points=points[source].astype(np.float32),
            intensity=intensity[source].astype(np.float32),
            offsets=np.broadcast_to(offsets, ranges.shape)[source].astype(np.float32),
            reflectivity=self.sensor.profile in _CORRECTED,
        )

    def stamp(self, index: int) -> int:
        """When a turn ended, nanoseconds on the sensor's clock; 0 where its last packet is not valid."""
        return int(self._decode(self._turns[index][-1:])[2].max())

    def _decode(self, packets: list[tuple[Part, ...]]) -> tuple[Array, Array, NDArray[np.int64]]:
        """Ranges (H, W) in metres, intensities (H, W) and columns' times (W,) in nanoseconds, as they were fired."""
        s, p = self.sensor, PROFILES[self.sensor.profile]
        ranges, intensity = np.zeros((s.beams, s.columns)), np.zeros((s.beams, s.columns))
        times = np.zeros(s.columns, dtype=np.int64)
        kind, place = p.intensity
        for parts in packets:
            payload = np.frombuffer(b"".join(self._bytes[a:b] for a, b in parts), dtype=np.uint8)
            body = payload[p.packet_header : p.packet_header + s.packet_columns * self._column_size]
            columns = body.reshape(s.packet_columns, self._column_size)
            numbers = _field(columns, 8, "<u2").astype(np.int64)
            pixels = columns[:, p.column_header : p.column_header + s.beams * p.pixel].reshape(-1, s.beams, p.pixel)
            status = _field(columns, self._column_size - 4, "<u4") if p.column_footer else _field(columns, 10, "<u2")
            good = ((status & 1) == 1) & (numbers < s.columns)
            raw = _field(pixels, 0, "<u4" if p.range_bits > 15 else "<u2").astype(np.int64) & ((1 << p.range_bits) - 1)
            ranges[:, numbers[good]] = p.range_unit * raw[good].T
            intensity[:, numbers[good]] = _field(pixels, place, kind)[good].T
            times[numbers[good]] = _field(columns, 0, "<u8")[good].astype(np.int64)
        return ranges, intensity, times

    def _points(self, ranges: Array) -> Array:
        """Points (H, W, 3) in the sensor's frame; zero where nothing came back."""
        s = self.sensor
        encoder = 2.0 * np.pi * (1.0 - np.arange(s.columns) / s.columns)
        azimuth, altitude = encoder[None, :] - s.azimuths[:, None], s.altitudes[:, None]
        reach = ranges - s.origin
        x = reach * np.cos(azimuth) * np.cos(altitude) + s.origin * np.cos(encoder)
        y = reach * np.sin(azimuth) * np.cos(altitude) + s.origin * np.sin(encoder)
        points = np.stack([x, y, reach * np.sin(altitude)], axis=-1)
        points = points @ s.T_sensor_lidar[:3, :3].T + s.T_sensor_lidar[:3, 3]
        points[ranges <= 0.0] = 0.0
        return np.asarray(points)


def _field(records: NDArray[np.uint8], place: int, kind: str) -> NDArray[Any]:
    """A number of each record (..., n) of bytes, from the byte ``place`` on."""
    size = np.dtype(kind).itemsize
    return np.ascontiguousarray(records[..., place : place + size]).view(kind)[..., 0]


def describe(file: Path) -> Path:
    """The description beside a capture: the ``.json`` whose name the capture's begins with.

    Raises:
        RecordingError: there is none.
    """
    beside = [f for f in file.parent.glob("*.json") if file.stem.startswith(f.stem)]
    if not beside:
        raise RecordingError(f"beside {file} there is no {file.stem}.json: put the sensor's description there")
    return max(beside, key=lambda f: len(f.stem))
