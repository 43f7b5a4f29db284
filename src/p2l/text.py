"""Text from outside, made harmless where it goes: to a terminal, a cell of a spreadsheet, a figure or a page."""

from __future__ import annotations

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
_SPACES_AND_JOINERS = frozenset("\u00a0\u3000\u200c\u200d")  # that names in Persian, Hindi, Chinese or emoji need


def printable(text: str, *, lines: bool = True) -> str:
    r"""`text` with everything that a terminal would act on written out; line breaks too without `lines`.

    Example:
        >>> from p2l.text import printable
        >>> print(printable("lid \x1b[31mred"))
        lid \x1b[31mred
    """
    return "".join(each if each.isprintable() or (lines and each == "\n") else repr(each)[1:-1] for each in text)


def drawable(text: str) -> str:
    r"""`text` in one line for a figure or a page: as `printable`, but for what scripts need within a word.

    Example:
        >>> from p2l.text import drawable
        >>> print(drawable("a\nb\u202ec"))
        a\nb\u202ec
    """
    return "".join(each if each in _SPACES_AND_JOINERS else printable(each, lines=False) for each in text)


def guarded_cell(text: str) -> str:
    """`text` as a spreadsheet shows it, and does not run it: an apostrophe goes before what begins like a formula.

    Example:
        >>> from p2l.text import guarded_cell
        >>> guarded_cell("=HYPERLINK(1)"), guarded_cell("cup")
        ("'=HYPERLINK(1)", 'cup')
    """
    return f"'{text}" if text.lstrip(" '").startswith(_FORMULA) or text.startswith(_FORMULA) else text
