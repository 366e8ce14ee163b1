"""Stage results kept on disk between edits: engine values as arrays behind a JSON skeleton.

A kept value is found by the digest of its inputs, choices and the engine's version. Files appear
whole or not at all; one that cannot be read is made anew.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import struct
import tempfile
import zlib
from pathlib import Path
from typing import Any, cast

import numpy as np

from engine import cholesky, correspondence, measures, types
from engine.pipeline import values

_VALUES: dict[str, type[Any]] = {
    name: value
    for module in (types, values, correspondence, measures, cholesky)
    for name, value in vars(module).items()
    if isinstance(value, type) and dataclasses.is_dataclass(value)
}

_HEAD = struct.Struct("<QQ")  # checksum of what follows, length of the skeleton
_ALIGNED = 16  # bytes


class StageCache:
    """Values by key in a folder; ``version`` tells engines apart."""

    def __init__(self, folder: Path, version: str) -> None:
        self._folder = folder
        self._version = version

    def _path(self, stage: str, key: str) -> Path:
        digest = hashlib.sha256(f"{self._version}\0{stage}\0{key}".encode()).hexdigest()
        return self._folder / digest[:2] / f"{digest}.kept"

    def get(self, stage: str, key: str) -> Any:
        """The kept value, or None."""
        path = self._path(stage, key)
        try:
            value = decode(path.read_bytes())
        except (FileNotFoundError, KeyError, TypeError, ValueError):
            return None
        path.touch()
        return value

    def put(self, stage: str, key: str, value: object) -> None:
        """Keep a value; the file is renamed into place when it is complete."""
        path = self._path(stage, key)
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as part:
            part.write(encode(value))
        Path(part.name).replace(path)


def encode(value: object) -> bytes:
    """An engine value, or a tuple or plain number of them: checksum, skeleton, and arrays as is.

    Reading is then one pass over the bytes, and its arrays are views of them.
    """
    arrays: list[np.ndarray[Any, Any]] = []
    skeleton = json.dumps(_flatten(value, arrays)).encode()
    skeleton += b" " * (-(_HEAD.size + len(skeleton)) % _ALIGNED)
    parts = [skeleton]
    for array in arrays:
        raw = array.tobytes()
        parts += [raw, bytes(-len(raw) % _ALIGNED)]
    body = b"".join(parts)
    return _HEAD.pack(zlib.crc32(body), len(skeleton)) + body


def decode(data: bytes) -> object:
    """The value that ``encode`` made ``data`` of; ``ValueError`` if it is not whole."""
    if len(data) < _HEAD.size:
        raise ValueError("a kept value without a head")
    checksum, length = _HEAD.unpack_from(data)
    if zlib.crc32(memoryview(data)[_HEAD.size :]) != checksum:
        raise ValueError("a kept value that is not as it was written")
    start = _HEAD.size + length
    return _build(json.loads(data[_HEAD.size : start]), _Arrays(data, start))


class _Arrays:
    """The arrays of a kept value, one after the other."""

    def __init__(self, data: bytes, start: int) -> None:
        self._data, self._at = data, start

    def take(self, dtype: str, shape: list[int]) -> np.ndarray[Any, Any]:
        count = math.prod(shape)
        array = np.frombuffer(self._data, np.dtype(dtype), count, self._at).reshape(shape)
        self._at += array.nbytes + -array.nbytes % _ALIGNED
        return array


def _flatten(value: object, arrays: list[np.ndarray[Any, Any]]) -> Any:
    if isinstance(value, np.ndarray):
        array = cast("np.ndarray[Any, Any]", value)
        arrays.append(array)
        return {"array": array.dtype.str, "shape": array.shape}
    if isinstance(value, tuple):
        return {"tuple": [_flatten(item, arrays) for item in cast("tuple[object, ...]", value)]}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        parts = {name: _flatten(item, arrays) for name, item in fields.items()}
        return {"value": type(value).__name__, "fields": parts}
    return value


def _build(skeleton: Any, arrays: _Arrays) -> Any:
    if not isinstance(skeleton, dict):
        return skeleton
    node = cast("dict[str, Any]", skeleton)
    if "array" in node:
        return arrays.take(node["array"], node["shape"])
    if "tuple" in node:
        return tuple(_build(item, arrays) for item in node["tuple"])
    fields = {name: _build(item, arrays) for name, item in node["fields"].items()}
    return _VALUES[node["value"]](**fields)
