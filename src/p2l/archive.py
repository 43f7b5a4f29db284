"""Files of finished stages among the committed records, for the next machine.

What hours of training rest on (failures, modes, preconditions, a predictor) is made in minutes, but on another
processor its last bits differ, a failure more or less is found, and a mixture settles elsewhere: what was learnt from
the first would be read as if it had been learnt from the second. So the files themselves are kept, known by what
decides them, and a stage whose files are here takes them instead of making them again.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from p2l.artifacts import atomic, digest_bytes
from p2l.errors import ArtifactError
from p2l.ledger import Item, find, place, write

log = logging.getLogger(__name__)
FILES = "files"


@dataclass(frozen=True)
class Archive:
    """The files of one finished stage.

    Attributes:
        records: folder of the ledger, or None where nothing is kept.
        item: the world or domain, the stage as its method, and the hash of all that decides the files.
        names: of the files, relative to the stage's folder.
    """

    records: Path | None
    item: Item
    names: Sequence[str]

    def restore(self, out: Path) -> bool:
        """Copy the files to `out`; False where there is no whole record of them, and nothing is touched.

        Raises:
            ArtifactError: `out` cannot be written.
        """
        if self.records is None or (record := find(self.records, self.item)) is None:
            return False
        digests = record["files"]
        folder = self._folder(self.records)
        contents = {name: _read(folder / name) for name in self.names}
        if wrong := [name for name, content in contents.items() if digest_bytes(content) != digests.get(name)]:
            log.warning("%s: %s missing or damaged; made anew", folder, ", ".join(wrong))
            return False
        for name, content in contents.items():
            with atomic(out / name) as temporary:
                temporary.write_bytes(content)
        log.info("taken from the record %s", folder.name)
        return True

    def keep(self, out: Path, *, seconds: float) -> None:
        """Leave copies of the files in `out`, the record last, so that it never names what is not there.

        Raises:
            ArtifactError: a file is missing, or the records cannot be written.
        """
        if self.records is None:
            return
        folder = self._folder(self.records)
        digests = {}
        for name in self.names:
            if not (content := _read(out / name)):
                raise ArtifactError(f"{out / name}: missing or empty, so this stage's files cannot be kept")
            digests[name] = digest_bytes(content)
            with atomic(folder / name) as temporary:
                temporary.write_bytes(content)
        write(self.records, self.item, {"files": digests}, seconds=seconds)

    def _folder(self, records: Path) -> Path:
        return records / FILES / Path(place(records, self.item)).stem


def digest_of(path: Path) -> str:
    """Digest of a file's bytes.

    Raises:
        ArtifactError: it cannot be read.
    """
    try:
        return digest_bytes(path.read_bytes())
    except OSError as error:
        raise ArtifactError(f"{path}: no such artifact; run the stage that makes it (see `dvc dag`)") from error


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""
