"""Reading and writing artifacts: atomic, versioned, digested, never pickled.

Arrays live in `.npz`, tables in Parquet, small facts in JSON, networks in safetensors beside a JSON card. Each
carries a schema name, a version and a digest of its content; a loader checks all three, since DVC does not notice
a damaged cache file. Heavy readers are imported by the function that needs them, so that a stage pays only for
what it uses.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import re
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from p2l.errors import ArtifactError

if TYPE_CHECKING:
    import pandas as pd
    import torch

AnyArray = npt.NDArray[Any]
_META = "__p2l__"
_ANEW = "Delete it and run the stage that makes it again (`dvc repro` in the pipeline)."
_HOST = re.sub(r"\W", "", platform.node()) or "here"


@contextmanager
def atomic(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success it replaces `path`, on any error nothing is left behind.

    What a killed process left of `path` goes, too.

    Raises:
        ArtifactError: the folder cannot be written, or the disk is full.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for file in _temporaries(path):
            if not _is_alive(file):
                file.unlink(missing_ok=True)
        prefix = f".{path.stem}.{_HOST}-{os.getpid()}-"
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=prefix, suffix=path.suffix)
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be written ({error.strerror or error})") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        temporary.unlink(missing_ok=True)


def _temporaries(path: Path) -> list[Path]:
    """Files that were to become `path`, written by processes of this machine."""
    start = f".{path.stem}.{_HOST}-"
    try:
        return [file for file in path.parent.iterdir() if file.name.startswith(start) and file.suffix == path.suffix]
    except OSError:
        return []


def _is_alive(temporary: Path) -> bool:
    """Whether the process that writes a temporary file still runs."""
    process = temporary.name.partition(f".{_HOST}-")[2].partition("-")[0]
    try:
        os.kill(int(process), 0)
    except (ProcessLookupError, ValueError):
        return False
    except PermissionError:  # somebody else's
        return True
    return True


def write_text(path: Path | str, text: str) -> None:
    """Write UTF-8 text atomically."""
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def config_hash(config: Any) -> str:
    """A short stable hash of plain data (dicts, lists, numbers, strings)."""
    return hashlib.blake2b(json.dumps(config, sort_keys=True, default=str).encode(), digest_size=8).hexdigest()


def digest_bytes(content: bytes) -> str:
    """Digest of a file's bytes."""
    return hashlib.blake2b(content, digest_size=16).hexdigest()


def _digest_arrays(arrays: Mapping[str, AnyArray]) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name}:{array.dtype.str}:{array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _require(path: Path) -> Path:
    if not path.is_file():
        raise ArtifactError(f"{path}: no such artifact; run the stage that makes it (see `dvc dag`)")
    return path


def _check(path: Path, meta: Mapping[str, Any], schema: str, version: int, digest: str) -> None:
    if meta.get("schema") != schema or meta.get("version") != version:
        raise ArtifactError(
            f"{path}: holds schema '{meta.get('schema')}' version {meta.get('version')}; "
            f"expected '{schema}' version {version}. Run the stage that makes it again."
        )
    if meta.get("digest") != digest:
        raise ArtifactError(f"{path}: content does not match its digest (damaged). {_ANEW}")


def part(arrays: Mapping[str, AnyArray], prefix: str) -> dict[str, AnyArray]:
    """The arrays whose names begin with `prefix`, without it."""
    return {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}


def save_arrays(path: Path | str, arrays: Mapping[str, AnyArray], *, schema: str, version: int) -> None:
    """Write named arrays to a compressed `.npz` with schema, version and digest inside."""
    content = {name: np.asarray(array) for name, array in arrays.items()}
    if bad := [name for name, array in content.items() if array.dtype.hasobject or name == _META]:
        raise ArtifactError(f"{path}: arrays {bad} hold Python objects or use a reserved name")
    meta = json.dumps({"schema": schema, "version": version, "digest": _digest_arrays(content)})
    with atomic(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **content, **{_META: np.frombuffer(meta.encode(), np.uint8)})


def load_arrays(path: Path | str, *, schema: str, version: int) -> dict[str, AnyArray]:
    """Read a `.npz` written by `save_arrays`.

    Raises:
        ArtifactError: missing, unreadable, of another schema or version, or damaged.
    """
    path = _require(Path(path))
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        meta = json.loads(arrays.pop(_META).tobytes())
        if not isinstance(meta, dict):
            raise ValueError("it does not say what it is")
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise ArtifactError(f"{path}: not a p2l array artifact ({error})") from error
    except Exception as error:  # zipfile and zlib raise their own types on damaged data
        raise ArtifactError(f"{path}: damaged ({error}). {_ANEW}") from error
    _check(path, meta, schema, version, _digest_arrays(arrays))
    return arrays


def save_json(path: Path | str, content: Mapping[str, Any], *, schema: str, version: int) -> None:
    """Write small facts; NaN and infinity are refused because JSON has neither."""
    if clash := {"schema", "version", "digest"} & set(content):
        raise ArtifactError(f"{path}: reserved keys {sorted(clash)}")
    try:
        plain = json.loads(json.dumps(content, allow_nan=False))  # as a reader will see it: keys are text
    except (TypeError, ValueError) as error:
        raise ArtifactError(f"{path}: cannot be written as JSON ({error})") from error
    envelope = {"schema": schema, "version": version, "digest": _digest_json(plain), **plain}
    write_text(path, json.dumps(envelope, indent=1, allow_nan=False) + "\n")


def load_json(path: Path | str, *, schema: str, version: int) -> dict[str, Any]:
    """Read a JSON artifact written by `save_json` (raises `ArtifactError`)."""
    path = _require(Path(path))
    try:
        envelope: dict[str, Any] = dict(json.loads(path.read_text(encoding="utf-8")))
    except (TypeError, ValueError) as error:
        raise ArtifactError(f"{path}: not a JSON artifact ({error})") from error
    content = {key: value for key, value in envelope.items() if key not in ("schema", "version", "digest")}
    _check(path, envelope, schema, version, _digest_json(content))
    return content


def _digest_json(content: Mapping[str, Any]) -> str:
    return digest_bytes(json.dumps(content, sort_keys=True).encode())


def save_table(path: Path | str, table: pd.DataFrame, *, schema: str, version: int) -> None:
    """Write a table to Parquet with schema, version and digest in its metadata; the index is not kept."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrow = pa.Table.from_pandas(table, preserve_index=False)
    meta = {"schema": schema, "version": version, "digest": _digest_table(arrow)}
    arrow = arrow.replace_schema_metadata({_META: json.dumps(meta)})
    with atomic(path) as temporary:
        pq.write_table(arrow, temporary)


def load_table(path: Path | str, *, schema: str, version: int) -> pd.DataFrame:
    """Read a Parquet table written by `save_table` (raises `ArtifactError`)."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = _require(Path(path))
    try:
        arrow = pq.read_table(path)
        meta = json.loads((arrow.schema.metadata or {})[_META.encode()])
    except (pa.ArrowException, OSError, KeyError, ValueError) as error:
        raise ArtifactError(f"{path}: not a p2l table ({error})") from error
    _check(path, meta, schema, version, _digest_table(arrow))
    frame: pd.DataFrame = arrow.replace_schema_metadata(None).to_pandas()
    return frame


def _digest_table(arrow: Any) -> str:
    body = json.dumps({name: arrow.column(name).to_pylist() for name in arrow.column_names}, default=str)
    return digest_bytes(body.encode())


def save_network(path: Path | str, state: Mapping[str, torch.Tensor], card: Mapping[str, Any], *, schema: str) -> None:
    """Write weights to `<path>` (safetensors) and what they mean to `<path>.json`; the card holds their digest.

    Weights are whole on disk before the card names them. A process that is killed between the two renames leaves them
    beside the card, where `load_network` finds them.
    """
    from safetensors.torch import save

    path = Path(path)
    data = save({name: tensor.detach().cpu().contiguous() for name, tensor in state.items()})
    weights = digest_bytes(data)
    with atomic(path) as temporary:
        with temporary.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        beside = path.with_suffix(path.suffix + ".json")
        save_json(beside, {**card, "weights": weights}, schema=schema, version=1)  # nothing but a rename lies between


def load_network(path: Path | str, *, schema: str) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Read weights and card written by `save_network` (raises `ArtifactError`)."""
    from safetensors.torch import load

    path = Path(path)
    card = load_json(path.with_suffix(path.suffix + ".json"), schema=schema, version=1)
    digest = card.pop("weights")
    for file in (path, *_temporaries(path)):
        if file.is_file() and digest_bytes(data := file.read_bytes()) == digest:
            if file != path:
                file.replace(path)  # its process was killed before it could
            return load(data), card
    _require(path)
    raise ArtifactError(f"{path}: weights do not match their card. {_ANEW}")


def is_artifact(path: Path) -> bool:
    """Whether a file says that it was written by this module, whole or not; weights say so by their card."""
    try:
        if path.suffix == ".npz":
            return f"{_META}.npy" in zipfile.ZipFile(path).namelist()
        if path.suffix == ".parquet":
            return _META.encode() in path.read_bytes()[-1_000_000:]
        card = path if path.suffix == ".json" else path.with_suffix(path.suffix + ".json")
        return {"schema", "version", "digest"} <= set(json.loads(card.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, zipfile.BadZipFile):
        return False


def finite(value: float) -> float | None:
    """`value`, or None where JSON and MLflow cannot hold it (NaN, infinity)."""
    return float(value) if math.isfinite(value) else None
