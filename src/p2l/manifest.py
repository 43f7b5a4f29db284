"""The manifest of a stage's folder: digests of the files in it that carry none themselves.

Arrays, tables in Parquet, facts in JSON and networks hold a digest of their content (`p2l.artifacts`). A CSV, a PNG, a
YAML or a film has no place for one, and half a CSV is still a CSV: whoever reads one that a stage wrote asks the
manifest first.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from p2l.artifacts import digest_bytes, load_json, save_json
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
