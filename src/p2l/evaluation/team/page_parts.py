"""Parts of the page of a plan: its look, and names, numbers and tables as HTML."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from p2l.errors import ArtifactError, InputError
from p2l.evaluation.team.look import COLOURS, amount
from p2l.text import drawable

NONE = "–"
_NAMES = 12  # of a cell; the rest are folded
_NUMBER = ' class="number"'
STYLE = """
:root { color-scheme: light dark; --ink: #1b1e22; --paper: #fff; --faint: #5c636a; --line: #d5d9dd; --box: #f2f4f5; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8e8e5; --paper: #16181b; --faint: #a3abb3; --line: #3b4147; --box: #22262a; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 16px/1.5 system-ui, "Segoe UI", "Noto Sans",
  "DejaVu Sans", sans-serif; }
main { max-width: 66rem; margin: 0 auto; padding: 1.2rem 1rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 .6rem; overflow-wrap: anywhere; }
h2 { font-size: 1.25rem; margin: 2.4rem 0 .5rem; } h3 { font-size: 1.05rem; margin: 1.6rem 0 .3rem; }
.headline { background: var(--box); border-radius: 8px; padding: .9rem 1.1rem; }
.headline p { margin: .2rem 0; } .total { font-size: 1.1rem; } .total b { font-size: 2rem; margin-right: .2rem; }
.counts { list-style: none; display: flex; flex-wrap: wrap; gap: .4rem 1.4rem; margin: .6rem 0 0; padding: 0; }
.counts li { border-left: .5rem solid var(--kind); padding-left: .5rem; }
.act { --kind: var(--act); } .delegate { --kind: var(--delegate); } .learn { --kind: var(--learn); }
figure { margin: 1.4rem 0 0; } img { max-width: 100%; height: auto; background: #fff; border-radius: 8px; }
.faint, caption { color: var(--faint); }
.wide { overflow-x: auto; }
table { border-collapse: collapse; min-width: 50%; font-size: .93rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-size: .88rem; padding-bottom: .4rem; }
th, td { padding: .35rem .7rem .35rem 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line); }
th { font-weight: 600; } thead th { vertical-align: bottom; line-height: 1.25; }
th:last-child, td:last-child { padding-right: 0; }
.day { width: 100%; } td, tbody th { min-width: 4.6rem; } tbody th { min-width: 6rem; }
bdi { overflow-wrap: anywhere; } td.number { min-width: 0; } .number { text-align: right; white-space: nowrap; }
thead .number { white-space: normal; } th .faint { font-weight: 400; }
.badge { border-left: .5rem solid var(--kind); padding-left: .4rem; white-space: nowrap; }
.key { font-size: .85rem; color: var(--faint); vertical-align: bottom; }
.bar { width: 24%; min-width: 7rem; } .bar span { display: flex; height: 1.1rem; margin-top: .15rem; }
.bar i, .key i { background: var(--kind); print-color-adjust: exact; -webkit-print-color-adjust: exact; }
.bar .risk, .key .risk { --kind: var(--act); border: 1px solid var(--kind);
  background: repeating-linear-gradient(135deg, var(--kind) 0 1px, transparent 1px 5px); }
.key i { display: inline-block; width: 1.6rem; height: .8rem; }
summary { cursor: pointer; margin: .6rem 0; } dl { display: grid; grid-template-columns: auto 1fr; gap: .25rem 1rem; }
dt { color: var(--faint); } dd { margin: 0; }
@media (max-width: 40rem) { body { font-size: 15px; } main { padding: .8rem .7rem 3rem; } .headline { padding: .8rem; }
  table { font-size: .86rem; } th, td { padding-right: .5rem; } .total b { font-size: 1.7rem; }
  .bar, .key { display: none; } td { min-width: 4rem; }
  tbody th { min-width: 5.2rem; } td.number { min-width: 0; } }
@media print { :root { color-scheme: light; --ink: #000; --paper: #fff; --faint: #444; --line: #bbb; --box: #fff; }
  body { font-size: 10pt; } main { max-width: none; padding: 0; } .headline { border: 1px solid var(--line); }
  .wide { overflow: visible; } tr, figure, .headline { break-inside: avoid; } h2, h3 { break-after: avoid; }
  .bar .risk, .key .risk { background: none; }
  .badge, .counts li, img { print-color-adjust: exact; -webkit-print-color-adjust: exact; } }
"""
STYLE = "".join(f":root {{ --{kind.name.lower()}: {colour}; }}\n" for kind, colour in COLOURS.items()) + STYLE


@dataclass(frozen=True)
class Column:
    """A column of given facts: its heading, its key, and whether it is of numbers."""

    head: str
    key: str
    is_number: bool = False


def shows(path: Path | str, parts: Mapping[str, str]) -> bool:
    """Whether there is a page at all; where there is, it has to show some parts, each under a name for messages.

    Raises:
        ArtifactError: the page cannot be read.
        InputError: it does not show one of them.
    """
    page = Path(path)
    if not page.exists():
        return False
    try:
        text = page.read_bytes().decode()
    except (OSError, UnicodeDecodeError) as error:
        raise ArtifactError(f"{page}: cannot be read as the page of a plan ({error}); plan again") from error
    for what, part in parts.items():
        if part not in text:
            raise InputError.at(page, None, None, f"does not show the {what} of this plan; plan again")
    return True


def word(text: str) -> str:
    """A text from outside as HTML."""
    return escape(drawable(text))


def name(text: str) -> str:
    """A name as HTML, isolated from the direction of the text around it."""
    return f"<bdi>{word(text)}</bdi>"


def names(texts: Iterable[str]) -> str:
    """Names as HTML; of many, most are folded."""
    items = [name(text) for text in texts]
    first = ", ".join(items[:_NAMES])
    if len(items) <= _NAMES:
        return first
    rest = ", ".join(items[_NAMES:])
    return f"{first} <details><summary>and {len(items) - _NAMES:,} more</summary>{rest}</details>"


def cell(value: object) -> str:
    """A given value as HTML: a cost, a name, several names, or a dash for nothing."""
    if value is None or value == "":
        return NONE
    if isinstance(value, (int, float, np.number)):
        number = float(value)
        return NONE if math.isnan(number) else "any cost" if number == math.inf else amount(number)
    if isinstance(value, str):
        return name(value)
    return (names(str(each) for each in value) or NONE) if isinstance(value, Iterable) else name(str(value))


def listing(items: Iterable[str]) -> str:
    """A list of pieces of HTML."""
    return "<ul>" + "".join(f"<li>{item}</li>" for item in items) + "</ul>"


def table(note: str, head: str, lines: Sequence[str], kind: str = "facts") -> str:
    """A table of rows of HTML, which can be moved sideways where it is too wide."""
    return (
        f'<div class="wide"><table class="{kind}">\n<caption>{note}</caption>\n'
        f"<thead><tr>{head}</tr></thead>\n<tbody>\n" + "\n".join(lines) + "\n</tbody>\n</table></div>"
    )


def header(text: str, is_number: bool = False) -> str:
    """The head of a column."""
    return f'<th scope="col"{_NUMBER if is_number else ""}>{text}</th>'


def facts(columns: Sequence[Column], rows: Sequence[Mapping[str, Any]], note: str) -> str:
    """A table of given values, one column for each key; what is missing is a dash."""
    lines = [
        "<tr>"
        + "".join(f"<td{_NUMBER if each.is_number else ''}>{cell(row.get(each.key))}</td>" for each in columns)
        + "</tr>"
        for row in rows
    ]
    return table(note, "".join(header(each.head, each.is_number) for each in columns), lines)
