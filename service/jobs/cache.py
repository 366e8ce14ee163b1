"""Stage results kept on disk between edits: engine values as arrays beside a JSON skeleton.

A kept value is found by the digest of its inputs, choices and the engine's version. Files appear
whole or not at all; one that cannot be read is made anew.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import tempfile
import zipfile
from pathlib import Path
from typing import Any, cast

import numpy as np

from engine import correspondence, types
from engine.pipeline import values

_VALUES: dict[str, type[Any]] = {
    name: value
    for module in (types, values, correspondence)
    for name, value in vars(module).items()
    if isinstance(value, type) and dataclasses.is_dataclass(value)
}


class StageCache:
    """Values by key in a folder; ``version`` tells engines apart."""

    def __init__(self, folder: Path, version: str) -> None:
        self._folder = folder
        self._version = version

    def _path(self, stage: str, key: str) -> Path:
        digest = hashlib.sha256(f"{self._version}\0{stage}\0{key}".encode()).hexdigest()
        return self._folder / digest[:2] / f"{digest}.npz"

    def get(self, stage: str, key: str) -> Any:
        """The kept value, or None."""
        path = self._path(stage, key)
        try:
            value = decode(path.read_bytes())
        except (FileNotFoundError, zipfile.BadZipFile, KeyError, ValueError, EOFError):
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
    """An engine value, or a tuple or plain number of them, as the bytes of an npz archive."""
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    skeleton = json.dumps(_flatten(value, arrays))
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, skeleton=np.array(skeleton), **arrays)
    return buffer.getvalue()


def decode(data: bytes) -> object:
    """The value that ``encode`` made ``data`` of."""
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        return _build(json.loads(str(archive["skeleton"])), archive)


def _flatten(value: object, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    if isinstance(value, np.ndarray):
        name = f"a{len(arrays)}"
        arrays[name] = value
        return {"array": name}
    if isinstance(value, tuple):
        return {"tuple": [_flatten(item, arrays) for item in cast("tuple[object, ...]", value)]}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        parts = {name: _flatten(item, arrays) for name, item in fields.items()}
        return {"value": type(value).__name__, "fields": parts}
    return value


def _build(skeleton: Any, archive: Any) -> Any:
    if not isinstance(skeleton, dict):
        return skeleton
    node = cast("dict[str, Any]", skeleton)
    if "array" in node:
        return archive[node["array"]]
    if "tuple" in node:
        return tuple(_build(item, archive) for item in node["tuple"])
    fields = {name: _build(item, archive) for name, item in node["fields"].items()}
    return _VALUES[node["value"]](**fields)
