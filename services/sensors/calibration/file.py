"""The calibration as a TOML file: the two cameras as they are, and how the pair is mounted on the vehicle."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from common import geometry
from common.camera import OPTICAL_IN_VEHICLE
from common.errors import ConfigurationError
from services.sensors.calibration.rig import Lens, StereoRig

Array = NDArray[np.float64]

_Focal = Annotated[float, Field(gt=0, le=1e5)]
_Pixel = Annotated[float, Field(ge=-1e5, le=1e5)]
_Side = Annotated[int, Field(ge=16, le=16384)]
_Angle = Annotated[float, Field(ge=-np.pi, le=np.pi)]
_Row = tuple[float, float, float]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class LensTable(_Table):
    """``[calibration.left]`` and ``[calibration.right]``; see :class:`Lens`."""

    fx: _Focal
    fy: _Focal
    cx: _Pixel
    cy: _Pixel
    distortion: tuple[float, ...]

    @model_validator(mode="after")
    def _is_of_a_model(self) -> Self:
        if len(self.distortion) not in (5, 8):
            raise ValueError("a lens has 5 or 8 coefficients of distortion")
        return self


class MountingTable(_Table):
    """``[calibration.mounting]``: the rectified left camera in the vehicle's frame (x forward, y left, z up).

    ``position`` in metres; ``roll``, ``pitch`` and ``yaw`` in radians are those of a camera that looks along x: the
    rotation is ``Rz(yaw) Ry(pitch) Rx(roll)``, and a camera that looks down has a positive pitch.
    """

    position: _Row = (0.0, 0.0, 0.0)
    roll: _Angle = 0.0
    pitch: _Angle = 0.0
    yaw: _Angle = 0.0

    def transform(self) -> Array:
        """``T_vehicle_camera`` (4, 4) of the left optical frame."""
        turns = [geometry.so3_exp(axis) for axis in ([0, 0, self.yaw], [0, self.pitch, 0], [self.roll, 0, 0])]
        return np.asarray(geometry.transform(turns[0] @ turns[1] @ turns[2], self.position) @ OPTICAL_IN_VEHICLE)

    @classmethod
    def of(cls, T_vehicle_camera: Array) -> Self:
        """Inverse of :meth:`transform`."""
        R = T_vehicle_camera[:3, :3] @ OPTICAL_IN_VEHICLE[:3, :3].T
        x, y, z = (float(value) for value in T_vehicle_camera[:3, 3])
        pitch = float(np.arcsin(np.clip(-R[2, 0], -1.0, 1.0)))
        roll, yaw = float(np.arctan2(R[2, 1], R[2, 2])), float(np.arctan2(R[1, 0], R[0, 0]))
        return cls(position=(x, y, z), roll=roll, pitch=pitch, yaw=yaw)


class CalibrationTable(_Table):
    """``[calibration]``; see :class:`StereoRig`."""

    width: _Side
    height: _Side
    rotation: tuple[_Row, _Row, _Row]
    translation: _Row
    left: LensTable
    right: LensTable
    mounting: MountingTable = Field(default_factory=MountingTable)

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        if not geometry.is_transform(geometry.transform(self.rotation, self.translation), tolerance=1e-5):
            raise ValueError("'rotation' is no rotation matrix")
        if not 0.001 < np.linalg.norm(self.translation) < 100.0:
            raise ValueError("'translation' gives no baseline between 1 mm and 100 m")
        return self

    def rig(self) -> StereoRig:
        """The two cameras."""
        left, right = (
            Lens(t.fx, t.fy, t.cx, t.cy, np.asarray(t.distortion, dtype=np.float64)) for t in (self.left, self.right)
        )
        T = geometry.normalize(geometry.transform(self.rotation, self.translation))
        return StereoRig(self.width, self.height, left, right, T[:3, :3], T[:3, 3])


class _File(_Table):
    calibration: CalibrationTable


@dataclass(frozen=True, slots=True)
class Stored:
    """What a calibration file holds."""

    rig: StereoRig
    mounting: MountingTable


def load(path: Path) -> Stored:
    """The calibration in a TOML file.

    Raises:
        ConfigurationError: no such file, no TOML, or a wrong or missing key or value.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(
            f"cannot read the calibration {path} ({error.strerror}): make it with vtr calibrate"
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path} is not TOML: {error}") from None
    try:
        table = _File.model_validate(content).calibration
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"])) or "calibration"
        raise ConfigurationError(f"{path}: '{place}': {first['msg'].removeprefix('Value error, ')}") from None
    return Stored(table.rig(), table.mounting)


def text(rig: StereoRig, mounting: MountingTable, remarks: tuple[str, ...] = ()) -> str:
    """The file's text; ``remarks`` stand above it, a line each."""
    rows = ",\n".join(f"    {_list(row)}" for row in rig.R)
    lines = [
        *(f"# {remark}" for remark in remarks),
        "",
        "[calibration]",
        f"width = {rig.width} # pixels, of each image as the camera delivers it",
        f"height = {rig.height}",
        "# p_right = rotation p_left + translation, metres, in optical frames (z forward, x right, y down)",
        f"rotation = [\n{rows},\n]",
        f"translation = {_list(rig.T)}",
    ]
    for name, lens in (("left", rig.left), ("right", rig.right)):
        lines += ["", f"[calibration.{name}] # pixels; distortion is k1, k2, p1, p2, k3, as in OpenCV"]
        lines += [f"{key} = {getattr(lens, key):.6f}" for key in ("fx", "fy", "cx", "cy")]
        lines.append(f"distortion = {_list(lens.distortion)}")
    lines += [
        "",
        "[calibration.mounting] # the rectified left camera in the vehicle's frame: x forward, y left, z up",
        f"position = {_list(mounting.position)} # metres",
        *(f"{name} = {_number(getattr(mounting, name))}" for name in ("roll", "pitch", "yaw")),
    ]
    lines[-3] += " # radians, of a camera that looks forward; pitch is positive where it looks down"
    return "\n".join(lines).lstrip("\n") + "\n"


def _list(values: Array | tuple[float, ...]) -> str:
    return "[" + ", ".join(_number(float(value)) for value in values) + "]"


def _number(value: float) -> str:
    """A number as TOML's float, to nine decimals."""
    return repr(round(float(value), 9) + 0.0)
