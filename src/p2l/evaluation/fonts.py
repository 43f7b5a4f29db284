"""Fonts for names in any script: which installed ones have the letters, and which names none of them can draw."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from matplotlib import font_manager, ft2font

_FIRST = "DejaVu Sans"  # comes with matplotlib: Latin, Greek, Cyrillic, Hebrew, Arabic and signs
_NEXT = (
    "Noto Sans", "Noto Sans CJK SC", "Noto Sans CJK JP", "Noto Sans CJK KR", "Noto Sans SC", "Noto Sans JP",
    "Noto Sans KR", "Source Han Sans", "WenQuanYi Micro Hei", "WenQuanYi Zen Hei", "Droid Sans Fallback", "IPAGothic",
    "IPAexGothic", "NanumGothic", "PingFang SC", "Hiragino Sans", "Hiragino Sans GB", "Apple SD Gothic Neo",
    "Microsoft YaHei", "Yu Gothic", "Malgun Gothic", "SimHei", "Noto Sans Devanagari", "Lohit Devanagari", "Mangal",
    "Nirmala UI", "Kohinoor Devanagari", "Noto Sans Bengali", "Noto Sans Tamil", "Noto Sans Telugu", "Noto Sans Thai",
    "Loma", "Leelawadee UI", "Thonburi", "Noto Sans Ethiopic", "Noto Emoji", "Symbola", "Segoe UI Symbol",
    "Segoe UI Emoji", "Arial Unicode MS", "FreeSans", "Unifont",
)  # fmt: skip
_NO_LETTERS = re.compile(  # boxes for everything, or signs of mathematics in the places of other letters
    r"\.?Last ?Resort.*|Adobe Blank.*|STIX(NonUnicode|Size).*|cm(b|ex|mi|r|ss|sy|tt)10|DejaVu \w+ Display"
)
_UNSEEN = frozenset("\u200c\u200d\ufe0e\ufe0f")  # joiners and variants: nothing to draw


@dataclass(frozen=True)
class Fonts:
    """Families to draw texts with, in order of preference, and the letters that none of them has."""

    families: tuple[str, ...]
    missing: frozenset[str]

    def can_draw(self, text: str) -> bool:
        """Whether every letter of a text has a glyph."""
        return self.missing.isdisjoint(text)


def fonts_for(texts: Iterable[str]) -> Fonts:
    """Fewest families, those known to be good first, whose character maps have the letters of `texts`.

    A font that has been installed since matplotlib made its list is found, too. Fonts of coloured pictures, which
    matplotlib cannot draw, do not count.
    """
    letters = frozenset("".join(texts)) - _UNSEEN
    if all(each.isascii() for each in letters):
        return Fonts((_FIRST,), frozenset())
    missing = letters - _covered(font_manager.findfont(_FIRST), letters)
    families = [_FIRST]
    for entry in _entries() if missing else ():
        if found := _covered(font_manager.FontPath(entry.fname, entry.index), missing):
            families.append(entry.name)
            missing -= found
            if not missing:
                break
    return Fonts(tuple(families), missing)


def _entries() -> list[font_manager.FontEntry]:
    """An upright font of each installed family, of the weight nearest to the normal one."""
    manager = font_manager.fontManager
    known = {entry.fname for entry in manager.ttflist}
    for path in font_manager.findSystemFonts():
        if path not in known:
            try:
                manager.addfont(path)
            except (OSError, RuntimeError, ValueError):  # damaged, or of a kind that matplotlib cannot read
                continue
    best: dict[str, font_manager.FontEntry] = {}
    for entry in sorted(manager.ttflist, key=_plainness):
        if not _NO_LETTERS.fullmatch(entry.name):
            best.setdefault(entry.name, entry)
    rank = {name: place for place, name in enumerate(_NEXT)}
    return sorted(best.values(), key=lambda entry: (rank.get(entry.name, len(rank)), *_plainness(entry), entry.name))


def _plainness(entry: font_manager.FontEntry) -> tuple[bool, int]:
    weight = font_manager.weight_dict.get(str(entry.weight), entry.weight)
    return entry.style != "normal", abs(int(weight) - 400)


def _covered(path: str, letters: frozenset[str]) -> frozenset[str]:
    """Letters that the character map of a font has."""
    try:
        font = ft2font.FT2Font(path, face_index=getattr(path, "face_index", 0))
    except (OSError, RuntimeError, ValueError):
        return frozenset()
    if not font.face_flags & ft2font.FaceFlags.SCALABLE:
        return frozenset()
    return frozenset(each for each in letters if font.get_char_index(ord(each)))
