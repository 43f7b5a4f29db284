"""What every benchmark shares: the command line, the table on the screen and the JSON file."""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from p2l.artifacts import write_text
from p2l.errors import P2LError
from p2l.worlds.table import WORLDS

Row = Mapping[str, object]


def parser(doc: str | None) -> argparse.ArgumentParser:
    """A command line with `--json FILE`; the module's docstring is its help."""
    command_line = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    command_line.add_argument("--json", type=file_to_write, metavar="FILE", help="also write the rows to FILE")
    return command_line


def command(main: Callable[[], None]) -> None:
    """Run a benchmark; a mistake in what it was given is one message, and exit code 2."""
    try:
        main()
    except P2LError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def known_world(name: str) -> str:
    """A world's name or target, as argparse wants it checked."""
    try:
        return WORLDS.check(name)
    except P2LError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def positive(text: str) -> int:
    """A whole number above 0, as argparse wants it checked."""
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} given; it must be a whole number above 0")
    return number


def seed(text: str) -> int:
    """A whole number of at least 0, as argparse wants it checked."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} given; it must be a whole number of at least 0")
    return int(text)


def file_to_write(text: str) -> Path:
    """A file in a folder that is there, as argparse wants it checked before any work."""
    path = Path(text)
    if path.is_dir() or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text} given; it must be a file in a folder that is there")
    return path


def load_kernels() -> None:
    """Load the compiled kernels and say how long that took."""
    from p2l.team import facility

    start = time.perf_counter()
    facility.load_kernels()
    print(f"loading: {time.perf_counter() - start:.1f} s (about 15 s once per installation, to compile)")


def finish(rows: Sequence[Row], target: Path | None) -> None:
    """Print the rows as a table and write them to `target`, if there is one."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    cells = [columns, *[[_text(row.get(name)) for name in columns] for row in rows]]
    widths = [max(len(line[column]) for line in cells) for column in range(len(columns))]
    for line in cells:
        print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))
    if target is not None:
        machine = {"python": sys.version.split()[0], "machine": platform.machine(), "system": platform.system()}
        write_text(target, json.dumps({"machine": machine, "rows": [dict(row) for row in rows]}, indent=1) + "\n")


def _text(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
