"""The report on disk: page, tables, figures, headline numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from p2l.artifacts import atomic, finite, save_json, write_text
from p2l.errors import ArtifactError
from p2l.evaluation.page.page import Section, render


def headline(sections: Sequence[Section]) -> dict[str, float]:
    """All sections' headline numbers that are finite."""
    numbers = {name: value for section in sections for name, value in section.metrics.items()}
    return {name: value for name, value in numbers.items() if finite(value) is not None}


def save_report(out: Path, title: str, lead: Sequence[str], sections: Sequence[Section]) -> None:
    """Write `index.html`, `tables/<name>.csv`, `figures/<name>.png` and `metrics.json`, each atomically.

    Raises:
        ArtifactError: two tables or two figures have the same name.
    """
    sheets = [sheet for section in sections for sheet in section.sheets]
    pictures = [picture for section in sections for picture in section.pictures]
    for names in ([sheet.name for sheet in sheets], [picture.name for picture in pictures]):
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ArtifactError(f"report: {', '.join(twice)} made by two sections; a name belongs to one")
    for sheet in sheets:
        with atomic(out / "tables" / f"{sheet.name}.csv") as temporary:
            sheet.long.to_csv(temporary, index=False, float_format="%.6g")
    for picture in pictures:
        with atomic(out / "figures" / f"{picture.name}.png") as temporary:
            temporary.write_bytes(picture.png)
    save_json(out / "metrics.json", headline(sections), schema="report_metrics", version=1)
    write_text(out / "index.html", render(title, lead, sections))
