"""What Hydra and the system say of a mistake on the command line, in words that help: `told_apart`.

A decimal comma, which Hydra takes for a list of values; a key that there is not, for which it advises a `+`, with which
there is not either; and a folder that is a file.
"""

from __future__ import annotations

import re

from p2l.schema import StageConfig, unknown_key

_COMMA = re.compile(r"(?:Ambiguous value for argument|Error parsing override) '([^'=]+)=([+-]?\d*),(\d+)(%?)'")
_MISSING = re.compile(r"MissingMandatoryValue while resolving interpolation: Missing mandatory value: (\S+)")
_KEY = re.compile(r"Could not override '([^']+)'\.")


def told_apart(error: BaseException, schema: type[StageConfig]) -> BaseException:
    """The error, or one that says more to somebody who has mistaken what is looked for here.

    Args:
        error: raised while the command line was read.
        schema: of the stage.
    """
    if (found := _COMMA.match(str(error))) is not None:
        key, whole, decimals, percent = found.groups()
        value = f"{whole or '0'}.{decimals}"
        way = f"{key}={value}" if not percent else f"{key}={float(value) / 100:g}"
        return ValueError(f"{key}={whole},{decimals}{percent}: a comma makes a list here; write {way}")
    if (missing := _MISSING.match(str(error))) is not None:  # the folder of the run is named after it
        return ValueError(f"configuration: Missing mandatory value: {missing[1]} (key '{missing[1]}')")
    if (key_found := _KEY.match(str(error))) is not None and (told := unknown_key(key_found[1], schema)) is not None:
        return ValueError(told)
    if isinstance(error, (FileExistsError, NotADirectoryError)) and error.filename is not None:
        within = "is a file" if isinstance(error, FileExistsError) else "is in a file"
        return ValueError(f"{error.filename}: {within}; give a folder, or one that is still to be made")
    return error
