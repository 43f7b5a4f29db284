"""Tables that a stage has written, as its tests read them."""

import csv


def rows_of(path):
    """Rows of a CSV by its header."""
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))
