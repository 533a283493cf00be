"""What a Dask worker does: a part of a row of similarities.

A task names the images that it compares with instead of carrying them, hundreds of megabytes for a large environment.
A worker that is a thread of the server finds them in the server's memory. One elsewhere reads them from the storage,
once; should it die, another one reads them again.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from services.fleet.groups import Along, Bytes
from services.fleet.rows import Images, row
from services.fleet.stored import StaleObject, unpack_images

Array = NDArray[np.float64]

Read = Callable[[str], bytes | None]
"""Reads an object by its key, None where there is none; it can be sent to another process."""

_KEPT = 64
"""Blocks that a worker elsewhere keeps in memory."""

_lock = threading.Lock()
_held: dict[str, Images] = {}
_read: OrderedDict[str, Images] = OrderedDict()


@dataclass(frozen=True, slots=True)
class Block:
    """Some maps of a group.

    Attributes:
        name: of their images, unique.
        keys: the objects that hold these, one a map.
        read: reads one of them.
    """

    name: str
    keys: tuple[str, ...]
    read: Read

    @classmethod
    def of(cls, keys: Sequence[str], read: Read) -> Block:
        """The block of maps whose images are in these objects."""
        return cls(sha256("\n".join(keys).encode()).hexdigest(), tuple(keys), read)


@contextmanager
def held(blocks: Sequence[Block], images: Sequence[Images]) -> Iterator[None]:
    """Keeps the blocks' images within reach of this process's own workers."""
    names = [block.name for block in blocks]
    with _lock:
        _held.update(zip(names, images, strict=True))
    try:
        yield
    finally:
        with _lock:
            for name in names:
                _held.pop(name, None)


def part_of_row(new: Along, block: Block) -> Array:
    """The similarities of a new map to the maps of a block, in their order."""
    return row(new.values, _images(block), new.cell_height)


def _images(block: Block) -> Images:
    with _lock:
        found = _held.get(block.name)
        if found is None and block.name in _read:
            found = _read[block.name]
            _read.move_to_end(block.name)
    if found is not None:
        return found
    parts = [Images.of(_read_images(block, key)) for key in block.keys]
    found = Images(np.concatenate([part.values for part in parts]), np.concatenate([part.counts for part in parts]))
    with _lock:
        _read[block.name] = found
        while len(_read) > _KEPT:
            _read.popitem(last=False)
    return found


def _read_images(block: Block, key: str) -> Bytes:
    content = block.read(key)
    if content is None:
        raise StaleObject(f"the images {key} are stored no longer")
    return unpack_images(content).values
