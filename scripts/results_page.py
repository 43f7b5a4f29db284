"""docs/results.md from its template and the committed tables.

    python scripts/results_page.py

Nothing is run: a number that no table holds is refused.
"""

from __future__ import annotations

import sys
from pathlib import Path

from p2l.artifacts import write_text
from p2l.errors import ArtifactError
from p2l.evaluation.prose import render_page

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "results.md"


def main() -> int:
    """Write the page; returns the exit code."""
    template = PAGE.with_name(f"{PAGE.name}.j2").read_text(encoding="utf-8")
    try:
        write_text(PAGE, render_page(template, ROOT / "results" / "thesis" / "tables"))
    except ArtifactError as error:
        sys.stderr.write(f"results page: {error}\n")
        return ArtifactError.exit_code
    sys.stdout.write(f"{PAGE.relative_to(ROOT)} is made from results/thesis/tables\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
