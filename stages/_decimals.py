"""A decimal comma on the command line, which Hydra takes for a list of values."""

from __future__ import annotations

import re

_COMMA = re.compile(r"(?:Ambiguous value for argument|Error parsing override) '([^'=]+)=([+-]?\d*),(\d+)(%?)'")


def told_apart(error: BaseException) -> BaseException:
    """The error, or, where a number with a decimal comma was given, one that says how to write it."""
    if (found := _COMMA.match(str(error))) is None:
        return error
    key, whole, decimals, percent = found.groups()
    value = f"{whole or '0'}.{decimals}"
    way = f"{key}={value}" if not percent else f"{key}={float(value) / 100:g}"
    return ValueError(f"{key}={whole},{decimals}{percent}: a comma makes a list here; write {way}")
