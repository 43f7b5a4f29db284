"""Randomness is an argument: independent generators derived from a seed and a path of names.

`generator(3, "collect", "insertion", 7)` is the same stream on every machine and shares nothing with any other
path, so training, choosing and evaluating never meet the same numbers, and adding a consumer moves nobody else's.
"""

from __future__ import annotations

import hashlib
import json

import numpy as np
import numpy.typing as npt


def entropy(seed: int, *path: str | int) -> int:
    """128 bits that identify (seed, path); stable across processes and platforms."""
    text = json.dumps([int(seed), *(part if isinstance(part, str) else int(part) for part in path)])
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=16).digest(), "little")


def generator(seed: int, *path: str | int) -> np.random.Generator:
    """An independent PCG64 generator for one purpose, named by `path`."""
    return np.random.Generator(np.random.PCG64(entropy(seed, *path)))


def torch_seed(seed: int, *path: str | int) -> int:
    """A 63-bit seed for `torch.Generator.manual_seed`."""
    return entropy(seed, *path) & (2**63 - 1)


def generator_state(rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """What a generator will draw next, for a checkpoint: its state as JSON, in bytes."""
    return np.frombuffer(json.dumps(rng.bit_generator.state).encode(), dtype=np.uint8)


def restore_generator(rng: np.random.Generator, state: npt.NDArray[np.uint8]) -> None:
    """Let a generator of the same kind go on from `generator_state`."""
    rng.bit_generator.state = json.loads(state.tobytes())
