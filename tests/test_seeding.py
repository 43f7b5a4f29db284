"""Streams are named: stable across processes and machines, different for different names."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from p2l.seeding import entropy, generator, torch_seed

PATHS = st.lists(st.text(max_size=6) | st.integers(-50, 50), max_size=4)


def test_a_stream_never_changes():
    assert generator(3, "collect", "insertion", 7).integers(0, 1000, 4).tolist() == [422, 615, 396, 231]


@given(PATHS, PATHS, st.integers(0, 3), st.integers(0, 3))
def test_streams_are_equal_exactly_when_seed_and_path_are(first, second, seed, other):
    assert (entropy(seed, *first) == entropy(other, *second)) == ((seed, first) == (other, second))


def test_parts_cannot_be_glued_together():
    assert len({entropy(0, *path) for path in [("a/b",), ("a", "b"), ("a", 1), ("a", "1"), ("a/str:b",)]}) == 5


def test_a_numpy_integer_names_the_same_stream_as_an_integer():
    assert entropy(0, "block", np.int64(7)) == entropy(0, "block", 7)


@given(st.integers(0, 2**32 - 1))
def test_torch_takes_the_seed(seed):
    assert 0 <= torch_seed(seed, "weights") < 2**63
