import numpy as np
import pytest

from p2l.contracts.observation import Observation, Privileged
from p2l.errors import ShapeError


def test_columns_by_name():
    seen = Observation.of({"grip_pos_m": np.arange(6.0).reshape(2, 3), "actions": np.array([4, 5])})
    assert seen.names == ("grip_pos_m[0]", "grip_pos_m[1]", "grip_pos_m[2]", "actions")
    np.testing.assert_array_equal(seen["actions"], [[4.0], [5.0]])
    np.testing.assert_array_equal(seen.take([1])["grip_pos_m"], [[3.0, 4.0, 5.0]])
    with pytest.raises(ShapeError, match="no field 'pose'; fields: grip_pos_m, actions"):
        seen["pose"]


def test_history_keeps_the_newest_first():
    old, new = (Observation.of({"x": np.array([value])}) for value in (1.0, 2.0))
    stacked = Observation.stack([new, old])
    assert stacked.names == ("x", "x@-1")
    np.testing.assert_array_equal(stacked.values, [[2.0, 1.0]])
    assert isinstance(stacked, Observation)


def test_truth_is_never_an_observation():
    assert not isinstance(Privileged.of({"x": np.zeros(1)}), Observation)
    assert not issubclass(Observation, Privileged)
