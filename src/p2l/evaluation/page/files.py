"""The report on disk: page, tables, figures, headline numbers."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from p2l.artifacts import atomic, finite, save_json, write_text
from p2l.errors import ArtifactError
from p2l.evaluation.page.page import Section, render

# Names of headline numbers, as regular expressions, and the short ones of those that matter most.
_FEW = {
    r"table_3_2/adl": "lego_cost",
    r"figure_3_7/levels_adl_cheapest": "insertion_levels",
    r"table_3_1/orders_reproduced": "board_orders",
    r"figure_4_7/(\w+)/over_round_robin/final_gain": r"\1_value_gain",
    r"table_4_1/(\w+)/(recoveries|open_loop)/success": r"\1_\2",
    r"table_5_1/(\w+)/(rc|nominal)/success": r"\1_\2",
}


def headline(sections: Sequence[Section]) -> dict[str, float]:
    """All sections' headline numbers that are finite."""
    numbers = {name: value for section in sections for name, value in section.metrics.items()}
    return {name: value for name, value in numbers.items() if finite(value) is not None}


def save_report(out: Path, title: str, lead: Sequence[str], sections: Sequence[Section]) -> None:
    """Write `index.html`, `tables/<name>.csv`, `figures/<name>.png`, `metrics.json` and `headline.json`.

    Each is written atomically.

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
    numbers = headline(sections)
    save_json(out / "metrics.json", numbers, schema="report_metrics", version=1)
    write_text(out / "headline.json", json.dumps(narrow(numbers), indent=1, allow_nan=False) + "\n")
    write_text(out / "index.html", render(title, lead, sections))


def narrow(numbers: Mapping[str, float]) -> dict[str, float]:
    """The few numbers that `dvc metrics show` has room for, by short names."""
    few = {}
    for name, value in numbers.items():
        for pattern, short in _FEW.items():
            if match := re.fullmatch(pattern, name):
                few[match.expand(short)] = round(value, 4)
    return few
