"""What the server keeps of an environment, as bytes: images, rows of similarity, catalog, feedback, model.

All of it can be made again from what robots have stored. So a reader that finds something else than it expects, of
another version or torn, says so, and the server makes it anew. Nothing here is a pickle.
"""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.errors import RetraverseError
from common.messages import EnvironmentModel, EnvironmentSpectrum
from services.fleet.catalog import SharedMap
from services.fleet.feedback import Feedback
from services.fleet.groups import Along, Kind

Array = NDArray[np.float64]

VERSION: Final = 1
_MOST_BYTES = 1 << 30


class StaleObject(RetraverseError):
    """A derived object that cannot be used: it is made again."""


@dataclass(frozen=True, slots=True)
class Row:
    """A map's similarities (n,) to n maps, itself among them, and when they were computed, nanoseconds.

    All have images of one kind. Rows are read in the order in which they were made: each tells of those before it.
    """

    kind: Kind
    names: Sequence[str]
    values: Array
    made: int


def pack_images(images: Along) -> bytes:
    """A map's images, as they are compared."""
    kind = np.array([json.dumps(images.kind)])
    return _pack(values=images.values, cell_height=np.array(images.cell_height), kind=kind)


def unpack_images(content: bytes) -> Along:
    """What :func:`pack_images` made.

    Raises:
        StaleObject: it did not.
    """
    try:
        arrays = _unpack(content)
        kind = Kind(*json.loads(str(arrays["kind"][0])))
        values = arrays["values"]
        if values.dtype != np.int8 or values.shape[1:] != (kind.channels, kind.rows, kind.columns) or not len(values):
            raise ValueError("its values are not of its kind")
        return Along(kind, values, float(arrays["cell_height"]))
    except _WRONG as error:
        raise StaleObject(f"these are no images of a map ({error})") from None


def pack_row(row: Row) -> bytes:
    """A row of similarities."""
    kind = np.array([json.dumps(row.kind)])
    return _pack(kind=kind, names=np.array(row.names, dtype=np.bytes_), values=row.values, made=np.array(row.made))


def unpack_row(content: bytes) -> Row:
    """What :func:`pack_row` made.

    Raises:
        StaleObject: it did not.
    """
    try:
        arrays = _unpack(content)
        names, values = [name.decode() for name in arrays["names"].tolist()], arrays["values"]
        if values.dtype != np.float64 or values.shape != (len(names),) or not np.isfinite(values).all():
            raise ValueError("it has not one finite value for each name")
        return Row(Kind(*json.loads(str(arrays["kind"][0]))), names, values, int(arrays["made"]))
    except _WRONG as error:
        raise StaleObject(f"this is no row of similarities ({error})") from None


def pack_catalog(maps: Iterable[SharedMap]) -> bytes:
    """All known maps, but for what repeats have told of them."""
    return _pack_json([astuple(one)[:-1] for one in maps])


def unpack_catalog(content: bytes) -> list[SharedMap]:
    """What :func:`pack_catalog` made.

    Raises:
        StaleObject: it did not.
    """
    try:
        return [SharedMap(*values) for values in _unpack_json(content)]
    except _WRONG as error:
        raise StaleObject(f"this is no catalog ({error})") from None


def pack_feedback(feedback: Feedback) -> bytes:
    """The sums of all reports, and which these are: one object, so that none can be counted twice."""
    return _pack_json(feedback.to_json())


def unpack_feedback(content: bytes) -> Feedback:
    """What :func:`pack_feedback` made.

    Raises:
        StaleObject: it did not.
    """
    try:
        return Feedback.from_json(**_unpack_json(content))
    except _WRONG as error:
        raise StaleObject(f"these are no sums of reports ({error})") from None


def pack_model(model: EnvironmentModel, made_of: str) -> bytes:
    """A model, and the digest of what it was estimated from."""
    return _pack_json({"model": model.model_dump(mode="json"), "made_of": made_of})


def unpack_model(content: bytes) -> tuple[EnvironmentModel, str]:
    """What :func:`pack_model` made.

    Raises:
        StaleObject: it did not.
    """
    try:
        found = _unpack_json(content)
        return EnvironmentModel.model_validate(found["model"]), str(found["made_of"])
    except _WRONG as error:
        raise StaleObject(f"this is no model ({error})") from None


def pack_spectrum(spectrum: EnvironmentSpectrum) -> bytes:
    """What the rhythms of a model were found in."""
    told = np.array([json.dumps({"environment": spectrum.environment, "revision": spectrum.revision})])
    levels = np.array(spectrum.levels, dtype=np.float64).reshape(-1, 2)
    return _pack(told=told, frequencies=spectrum.frequencies, power=spectrum.power, levels=levels)


def unpack_spectrum(content: bytes) -> EnvironmentSpectrum:
    """What :func:`pack_spectrum` made.

    Raises:
        StaleObject: it did not.
    """
    try:
        arrays = _unpack(content)
        told = json.loads(str(arrays["told"][0]))
        fields = {"frequencies": arrays["frequencies"], "power": arrays["power"], "levels": arrays["levels"].tolist()}
        return EnvironmentSpectrum.model_validate({**told, **fields})
    except _WRONG as error:
        raise StaleObject(f"this is no spectrum ({error})") from None


_WRONG = (
    ValueError,
    TypeError,
    AttributeError,
    KeyError,
    IndexError,
    OSError,
    EOFError,
    zipfile.BadZipFile,
    zlib.error,
)


def _pack(**arrays: NDArray[Any]) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, version=np.array(VERSION), **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def _unpack(content: bytes) -> dict[str, NDArray[Any]]:
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    _check(int(arrays["version"]))
    return arrays


def _pack_json(value: object) -> bytes:
    return zlib.compress(json.dumps({"version": VERSION, "content": value}, allow_nan=False).encode(), 1)


def _unpack_json(content: bytes) -> Any:  # noqa: ANN401, whatever JSON can hold
    unpacker = zlib.decompressobj()
    text = unpacker.decompress(content, _MOST_BYTES)
    if not unpacker.eof:
        raise ValueError("it is cut short, or too large")
    found = json.loads(text)
    _check(found["version"])
    return found["content"]


def _check(version: int) -> None:
    if version != VERSION:
        raise ValueError(f"it is of version {version}, and this server's is {VERSION}")
