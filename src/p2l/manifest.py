"""The manifest of a stage's folder: digests of the files in it that carry none themselves.

Arrays, tables in Parquet, facts in JSON and networks hold a digest of their content (`p2l.artifacts`). A CSV, a PNG, a
YAML or a film has no place for one, and half a CSV is still a CSV: whoever reads one that a stage wrote asks the
manifest first.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from p2l.artifacts import digest_bytes, is_artifact, load_json, save_json
from p2l.errors import ArtifactError

FILE, SCHEMA, VERSION = "manifest.json", "manifest", 1
SUFFIXES = frozenset({".csv", ".png", ".yaml", ".mp4"})
_OWN = frozenset({"records", "runs", "checkpoints"})  # folders that are working state and no output
_DEPTH = 3  # folders between a file and its manifest, at most


def write_manifest(folder: Path, but: frozenset[str] = frozenset()) -> None:
    """Write the manifest of a finished stage's folder; none where no file needs one.

    Args:
        folder: of the stage.
        but: files directly in it that are no outputs.

    Raises:
        ArtifactError: a file cannot be read, or the manifest not be written.
    """
    files = {file.relative_to(folder).as_posix(): _digest(file) for file in _outputs(folder, but)}
    if files:
        save_json(folder / FILE, {"files": files}, schema=SCHEMA, version=VERSION)


def check_place(folder: Path) -> None:
    """Refuse a folder whose manifest somebody else wrote: it would be overwritten.

    Raises:
        ArtifactError: it is another program's.
    """
    if not (folder / FILE).is_file():
        return
    try:
        load_json(folder / FILE, schema=SCHEMA, version=VERSION)
    except ArtifactError as error:
        told = str(error).partition("; ")[0].rstrip(".")
        raise ArtifactError(f"{told}. It would be overwritten; move it, or name another hydra.run.dir") from error


def check_files(folder: Path, patterns: tuple[str, ...]) -> None:
    """Refuse a folder that holds a file, at a place that a stage writes to, which no stage has written.

    A CSV, PNG or film is a stage's as it stands in the manifest; arrays, tables and facts say themselves what they are,
    and so does a configuration. Anything else is, where a stage's manifest, configuration or run lies beside it.

    Args:
        folder: of the stage.
        patterns: of the paths in it that the stage writes.

    Raises:
        ArtifactError: there is such a file.
    """
    files = sorted({file for pattern in patterns for file in folder.glob(pattern) if file.is_file()})
    if not files:
        return
    listed = load_json(folder / FILE, schema=SCHEMA, version=VERSION)["files"] if (folder / FILE).is_file() else None
    has_traces = listed is not None or _says_run(folder / "run.json") or _says_config(folder / "config.yaml")
    for file in files:
        if not _is_ours(file, file.relative_to(folder).as_posix(), listed, has_traces=has_traces):
            raise ArtifactError(
                f"{file}: would be overwritten, and is not as a stage wrote it; move it, or name another hydra.run.dir"
            )


def _is_ours(file: Path, name: str, listed: Mapping[str, str] | None, *, has_traces: bool) -> bool:
    if name == "run.json":
        return _says_run(file)
    if file.suffix == ".yaml" and _says_config(file):
        return True
    if listed is not None and name in listed:
        return listed[name] == _digest(file)
    if name == "config.yaml":
        return False
    return is_artifact(file) or (has_traces and (listed is None or file.suffix not in SUFFIXES))


def _says_run(file: Path) -> bool:
    """Whether it is the memory of a tracked run."""
    try:
        return {"run_id", "store", "config_hash"} <= set(json.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return False


def _says_config(file: Path) -> bool:
    """Whether it is the whole configuration of a stage, which every stage leaves, and no part that a person wrote."""
    import yaml  # type: ignore[import-untyped]

    try:
        tracking = dict(yaml.safe_load(file.read_text(encoding="utf-8")))["tracking"]
    except (OSError, ValueError, TypeError, KeyError, yaml.YAMLError):
        return False
    return isinstance(tracking, dict) and set(tracking) == {"enabled", "uri"}


def read_checked(path: Path, advice: str) -> bytes:
    """Content of a file that a stage wrote, as it wrote it.

    Args:
        path: the file.
        advice: what makes it anew, for messages.

    Raises:
        ArtifactError: missing, not in the manifest of its stage, or not as it was written.
    """
    content = _read(path, advice)
    folders = [folder for folder in path.parents[:_DEPTH] if (folder / FILE).is_file()]
    if not folders:
        raise ArtifactError(f"{path}: no {FILE} says how it was written; {advice}")
    digests = load_json(folders[0] / FILE, schema=SCHEMA, version=VERSION)["files"]
    expected = digests.get(path.relative_to(folders[0]).as_posix())
    if expected is None:
        raise ArtifactError(f"{path}: is none of the files in {folders[0] / FILE}; {advice}")
    if expected != digest_bytes(content):
        raise ArtifactError(f"{path}: is not as its stage wrote it (damaged, or edited by hand); {advice}")
    return content


def _outputs(folder: Path, but: frozenset[str]) -> Iterator[Path]:
    for file in sorted(folder.rglob("*")):
        parts = file.relative_to(folder).parts
        hidden = any(part.startswith(".") for part in parts)
        if file.suffix in SUFFIXES and not hidden and parts[0] not in _OWN | but and file.is_file():
            yield file


def _digest(file: Path) -> str:
    return digest_bytes(_read(file, "it was there a moment ago"))


def _read(path: Path, advice: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be read ({error.strerror or error}); {advice}") from error
