"""Macros: a few primitives, then a nominal option, as actions of the recovery MDP; random ones, and neighbours.

Axis letters: K macros, A actions, C columns of an encoding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from p2l.artifacts import load_json
from p2l.errors import ArtifactError
from p2l.records import Array, IntArray

Macro = tuple[int, ...]
MACROS = "macros.json"  # beside the policy of a search
GO_ON = 0.65  # chance of one primitive more in a random macro
AGAIN = 0.5  # chance that it is the one before once more: what frees a hand mostly takes more than one step


@dataclass(frozen=True)
class MacroSpace:
    """All macros of a recovery MDP.

    Attributes:
        primitives: number of the agent's own actions, which come first.
        options: number of nominal options.
        longest: most primitives of a macro.
    """

    primitives: int
    options: int
    longest: int

    def random(self, rng: np.random.Generator) -> Macro:
        """Short ones are more likely than long ones, and so is going on in a direction; every macro can come."""
        length = min(int(rng.geometric(1.0 - GO_ON)) - 1, self.longest)
        body: list[int] = []
        for _ in range(length):
            again = body and rng.random() < AGAIN
            body.append(body[-1] if again else int(rng.integers(self.primitives)))
        return (*body, self._option(rng))

    def short(self) -> list[Macro]:
        """All of one primitive at most."""
        ends = range(self.primitives, self.primitives + self.options)
        return [(*body, option) for body in [(), *((one,) for one in range(self.primitives))] for option in ends]

    def neighbour(self, macro: Macro, rng: np.random.Generator) -> Macro:
        """With a primitive more, one fewer, another one, or another option."""
        *body, option = macro
        change = int(rng.integers(4))
        if change == 0 and len(body) < self.longest:
            body.insert(int(rng.integers(len(body) + 1)), int(rng.integers(self.primitives)))
        elif change == 1 and body:
            body.pop(int(rng.integers(len(body))))
        elif change == 2 and body:
            body[int(rng.integers(len(body)))] = int(rng.integers(self.primitives))
        else:
            option = self._option(rng)
        return (*body, option)

    def encoding(self, macros: Sequence[Macro]) -> Array:
        """[K, C]: how often each action occurs, which one comes first, which one last before the option, the length."""
        actions = self.primitives + self.options
        values = np.zeros((len(macros), 3 * actions + 1))
        for row, macro in zip(values, macros, strict=True):
            for action in macro:
                row[action] += 1.0
            row[actions + macro[0]] = 1.0
            row[2 * actions + macro[max(len(macro) - 2, 0)]] = 1.0
            row[-1] = len(macro)
        return values

    def _option(self, rng: np.random.Generator) -> int:
        return self.primitives + int(rng.integers(self.options))


def padded(macros: Sequence[Macro], width: int) -> IntArray:
    """[K, width] their actions, −1 after the end."""
    table = np.full((len(macros), width), -1, dtype=np.int64)
    for row, macro in zip(table, macros, strict=True):
        row[: len(macro)] = macro
    return table


def load_macros(folder: Path, actions: Sequence[str], most: int) -> list[Macro]:
    """The first of the macros that a search has left in `folder`, as indices into a policy's `actions`.

    Raises:
        ArtifactError: missing, damaged, or of other actions.
    """
    place = {name: index for index, name in enumerate(actions)}
    named = load_json(folder / MACROS, schema="macros", version=1)["macros"][:most]
    try:
        return [tuple(place[name] for name in macro.split(";")) for macro in named]
    except KeyError as error:
        raise ArtifactError(f"{folder / MACROS}: a macro of action {error}, which the policy there lacks") from error


def macro_of(row: IntArray) -> Macro:
    """The macro of a row of `padded`."""
    return tuple(int(action) for action in row if action >= 0)
