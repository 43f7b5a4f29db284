"""The parts of the report, and their rendering as one self-contained HTML page."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Literal

import pandas as pd

Agreement = Literal["yes", "partly", "no", "unsaid"]
MARKS: dict[Agreement, str] = {"yes": "✓ agrees", "partly": "≈ in part", "no": "✗ differs", "unsaid": ""}


@dataclass(frozen=True)
class Reading:
    """A claim of the thesis, empty if there is none, and our result in one line."""

    thesis: str
    ours: str
    agrees: Agreement = "unsaid"


@dataclass(frozen=True)
class PageTable:
    """A table: `long` is saved as `<name>.csv`, `head` and `rows` are on the page."""

    name: str
    long: pd.DataFrame
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str


@dataclass(frozen=True)
class Picture:
    """A figure, saved as `<name>.png`."""

    name: str
    png: bytes
    caption: str


@dataclass(frozen=True)
class Films:
    """Videos side by side.

    Attributes:
        films: (name, H.264 in an mp4, caption) of each.
    """

    films: Sequence[tuple[str, bytes, str]]


@dataclass(frozen=True)
class Link:
    """Where more is to be read: a file of the repository, from its root, and one of its headings."""

    file: str
    heading: str

    @property
    def href(self) -> str:
        """Address from `data/report/index.html`; the anchor is what renderers of Markdown make of a heading."""
        kept = "".join(letter for letter in self.heading.lower() if letter.isalnum() or letter in " -_")
        return f"../../{self.file}#{kept.replace(' ', '-')}"


Part = str | Reading | PageTable | Picture | Films | Link


@dataclass(frozen=True)
class Section:
    """One table or figure of the thesis with ours.

    Attributes:
        title: heading.
        parts: paragraphs (text), readings, sheets, pictures, films and links, in order.
        commands: what makes these numbers.
        metrics: headline numbers.
    """

    title: str
    parts: Sequence[Part]
    commands: Sequence[str] = ()
    metrics: Mapping[str, float] = field(default_factory=dict)

    @property
    def sheets(self) -> list[PageTable]:
        """Its tables."""
        return [part for part in self.parts if isinstance(part, PageTable)]

    @property
    def pictures(self) -> list[Picture]:
        """Its figures."""
        return [part for part in self.parts if isinstance(part, Picture)]


STYLE = """
:root { color-scheme: light dark; --ink: #1c1f23; --paper: #fbfbfa; --faint: #6a7077; --line: #d9dcdf; --box: #f0f1f2;
  --yes: #0b6e4f; --partly: #9a6700; --no: #b3261e; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e3; --paper: #17191c; --faint: #9aa1a9; --line: #3a3f45;
  --box: #22262a; --yes: #6fd3a8; --partly: #e3b341; --no: #ff8a80; } }
body { margin: 0 auto; max-width: 62rem; padding: 2rem 1.2rem 5rem; background: var(--paper); color: var(--ink);
  font: 16px/1.55 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
h1 { font-size: 1.9rem; margin: 0 0 .3rem; }
h2 { margin: 3rem 0 .6rem; padding-top: 1rem; border-top: 1px solid var(--line); }
a { color: inherit; } nav li { margin: .1rem 0; } .faint, figcaption, caption { color: var(--faint); font-size: .9rem; }
.films { display: flex; flex-wrap: wrap; gap: 1rem; } .films figure { margin: .4rem 0; width: 19rem; }
video { max-width: 100%; border-radius: 6px; } figure { margin: 1.4rem 0; } figcaption { margin-top: .4rem; }
img { max-width: 100%; max-height: 44rem; background: white; border-radius: 6px; padding: .5rem;
  box-sizing: border-box; }
.wide { overflow-x: auto; } table { border-collapse: collapse; margin: 1.2rem 0 .4rem;
  font-variant-numeric: tabular-nums; font-size: .92rem; }
caption { text-align: left; caption-side: bottom; padding-top: .5rem; }
th, td { padding: .3rem .8rem .3rem 0; text-align: left; border-bottom: 1px solid var(--line); vertical-align: top; }
th { font-weight: 600; } td { white-space: nowrap; }
.reading { border-left: 4px solid var(--line); padding: .1rem 0 .1rem .9rem; margin: .9rem 0; }
.reading p { margin: .15rem 0; } .yes { border-color: var(--yes); } .partly { border-color: var(--partly); }
.no { border-color: var(--no); } .mark { font-weight: 600; } .yes .mark { color: var(--yes); }
.partly .mark { color: var(--partly); } .no .mark { color: var(--no); }
pre { background: var(--box); padding: .6rem .8rem; border-radius: 6px; overflow-x: auto; font-size: .85rem; }
"""


def render(title: str, lead: Sequence[str], sections: Sequence[Section]) -> str:
    """The page; images are inside it and nothing is fetched; links lead to files of the repository."""
    links = "".join(f'<li><a href="#s{number}">{escape(one.title)}</a></li>' for number, one in enumerate(sections))
    body = "".join(_section(number, section) for number, section in enumerate(sections))
    intro = "".join(f"<p>{escape(line)}</p>" for line in lead)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style></head>\n'
        f"<body><h1>{escape(title)}</h1>{intro}<nav><ul>{links}</ul></nav>\n{body}</body></html>\n"
    )


def _section(number: int, section: Section) -> str:
    parts = "\n".join(_part(part) for part in section.parts)
    commands = escape("\n".join(section.commands))
    footer = f'<p class="faint">Made by:</p><pre>{commands}</pre>' if commands else ""
    return f'<section id="s{number}"><h2>{escape(section.title)}</h2>\n{parts}\n{footer}</section>\n'


def _part(part: Part) -> str:
    if isinstance(part, Reading):
        thesis = f'<p class="faint">Thesis: {escape(part.thesis)}</p>' if part.thesis else ""
        mark = f' <span class="mark">{MARKS[part.agrees]}</span>' if part.agrees != "unsaid" else ""
        return f'<div class="reading {part.agrees}">{thesis}<p>{escape(part.ours)}{mark}</p></div>'
    if isinstance(part, PageTable):
        head = "".join(f"<th>{escape(cell)}</th>" for cell in part.head)
        rows = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in part.rows)
        caption = f"{escape(part.caption)} Data: tables/{escape(part.name)}.csv"
        return f'<div class="wide"><table><caption>{caption}</caption><tr>{head}</tr>{rows}</table></div>'
    if isinstance(part, Picture):
        data = base64.b64encode(part.png).decode()
        image = f'<img alt="{escape(part.name)}" src="data:image/png;base64,{data}">'
        return f"<figure>{image}<figcaption>{escape(part.caption)}</figcaption></figure>"
    if isinstance(part, Films):
        return f'<div class="films">{"".join(_film(*film) for film in part.films)}</div>'
    if isinstance(part, Link):
        return f'<p>More: <a href="{escape(part.href)}">{escape(part.file)}, “{escape(part.heading)}”</a></p>'
    return f"<p>{escape(part)}</p>"


def _film(name: str, mp4: bytes, caption: str) -> str:
    source = f"data:video/mp4;base64,{base64.b64encode(mp4).decode()}"
    film = f'<video title="{escape(name)}" src="{source}" controls loop muted preload="metadata"></video>'
    return f"<figure>{film}<figcaption>{escape(caption)}</figcaption></figure>"
