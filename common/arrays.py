"""Numpy arrays as fields of pydantic models: checked for type, shape and finite values, never copied."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from common.geometry import is_transform

DTYPES = frozenset({"|b1", "|u1", "<u2", "<u4", "<u8", "|i1", "<i2", "<i4", "<i8", "<f4", "<f8"})
"""Element types that may travel: plain little-endian numbers, nothing that can hold an object."""

_FLOATS = frozenset({"<f4", "<f8"})


@dataclass(frozen=True, slots=True)
class ArraySpec:
    """What an array field accepts.

    Attributes:
        dtype: numpy type string such as ``<f8``; None accepts any of :data:`DTYPES`.
        shape: expected shape, None for a free axis; an empty tuple accepts any shape.
        rigid: whether every (4, 4) matrix must be a rigid transform.
    """

    dtype: str | None = None
    shape: tuple[int | None, ...] = ()
    rigid: bool = False

    def check(self, value: object) -> NDArray[Any]:
        """The array itself.

        Raises:
            ValueError: it is no array, or of another type or shape, or not finite, or not rigid.
        """
        if isinstance(value, (list, tuple)) and self.dtype is not None:
            value = np.asarray(value, dtype=self.dtype)
        if not isinstance(value, np.ndarray):
            raise ValueError(f"expected an array, got {type(value).__name__}")  # noqa: TRY004, pydantic reports ValueError
        dtype = value.dtype.str
        if self.dtype is not None and dtype != self.dtype:
            raise ValueError(f"expected elements of type {self.dtype}, got {dtype}")
        if dtype not in DTYPES:
            raise ValueError(f"elements of type {dtype} cannot travel")
        if self.shape and not self._fits(value.shape):
            raise ValueError(f"expected shape {self.shape}, got {value.shape}")
        if self.rigid:
            if not is_transform(value):
                raise ValueError("not a rigid transform")
        elif dtype in _FLOATS and not np.isfinite(value).all():
            raise ValueError("the array holds NaN or infinity")
        return value

    def _fits(self, shape: tuple[int, ...]) -> bool:
        return len(shape) == len(self.shape) and all(
            want is None or want == have for want, have in zip(self.shape, shape, strict=True)
        )

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.check, serialization=core_schema.plain_serializer_function_ser_schema(_as_lists, when_used="json")
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Nested lists of numbers as far as the shape is known; ``dtype`` is a note on the elements."""
        made: JsonSchemaValue = {} if not self.shape else {"type": "number" if self.dtype in _FLOATS else "integer"}
        for size in reversed(self.shape):
            made = {"type": "array", "items": made}
            if size is not None:
                made |= {"minItems": size, "maxItems": size}
        return {"type": "array", "dtype": self.dtype or "any"} | made


def _as_lists(value: NDArray[Any]) -> Any:  # noqa: ANN401, nested lists of numbers
    return value.tolist()


AnyArray = Annotated[NDArray[Any], ArraySpec()]
Transform = Annotated[NDArray[np.float64], ArraySpec("<f8", (4, 4), rigid=True)]
Transforms = Annotated[NDArray[np.float64], ArraySpec("<f8", (None, 4, 4), rigid=True)]
Covariance = Annotated[NDArray[np.float64], ArraySpec("<f8", (6, 6))]
Covariances = Annotated[NDArray[np.float64], ArraySpec("<f8", (None, 6, 6))]
Twist = Annotated[NDArray[np.float64], ArraySpec("<f8", (6,))]
Vector = Annotated[NDArray[np.float64], ArraySpec("<f8", (None,))]
Actions = Annotated[NDArray[np.float64], ArraySpec("<f8", (None, 3))]
Ranges = Annotated[NDArray[np.float32], ArraySpec("<f4", (None, None))]
Pixels = Annotated[NDArray[np.float32], ArraySpec("<f4", (None, 2))]
Image = Annotated[NDArray[np.uint8], ArraySpec("|u1")]
Descriptors = Annotated[NDArray[np.uint8], ArraySpec("|u1", (None, 32))]
"""Binary descriptors of 256 bits."""
Indices = Annotated[NDArray[np.int32], ArraySpec("<i4")]
