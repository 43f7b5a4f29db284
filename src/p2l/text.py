"""Text from outside, made harmless where it goes: to a terminal, or into a cell of a spreadsheet."""

from __future__ import annotations

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def printable(text: str, *, lines: bool = True) -> str:
    r"""`text` with everything that a terminal would act on written out; line breaks too without `lines`.

    Example:
        >>> from p2l.text import printable
        >>> print(printable("lid \x1b[31mred"))
        lid \x1b[31mred
    """
    return "".join(each if each.isprintable() or (lines and each == "\n") else repr(each)[1:-1] for each in text)


def guarded_cell(text: str) -> str:
    """`text` as a spreadsheet shows it, and does not run it: an apostrophe goes before what begins like a formula.

    Example:
        >>> from p2l.text import guarded_cell
        >>> guarded_cell("=HYPERLINK(1)"), guarded_cell("cup")
        ("'=HYPERLINK(1)", 'cup')
    """
    return f"'{text}" if text.lstrip(" '").startswith(_FORMULA) or text.startswith(_FORMULA) else text
