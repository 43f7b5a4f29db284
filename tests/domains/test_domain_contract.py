"""Every registered domain keeps the contract of `p2l.contracts.domain`; a new one is covered on the day it is added."""

import subprocess
import sys
from typing import get_args

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from p2l.contracts.domain import Domain, Encoding, Tasks
from p2l.domains.table import DOMAINS, make_domain
from p2l.errors import ConfigError, ShapeError
from p2l.evaluation.transfer.strategies import strategy_figure

# Budgets that keep a domain's contract test short; a domain without an entry runs with its defaults.
CHEAP: dict[str, dict[str, object]] = {"lego": {"candidates": 500}}
DRAWS = 2


@pytest.fixture(scope="module", params=DOMAINS.names())
def collected(request):
    domain = make_domain(request.param, CHEAP.get(request.param))
    tasks = domain.sample_tasks(np.random.default_rng(0), 4)
    seen: list[tuple[int, int]] = []
    skills = domain.learn(
        tasks, np.array([0, 3]), np.random.default_rng(1), lambda done, total: seen.append((done, total))
    )
    success = domain.evaluate(skills, tasks.take([0, 3]), tasks, DRAWS, np.random.default_rng(2))
    return domain, tasks, skills, success, seen


def test_records_and_shapes(collected):
    domain, tasks, skills, success, seen = collected
    assert isinstance(domain, Domain)
    assert domain.encoding in get_args(Encoding)
    assert tasks.features.shape == (4, len(domain.feature_names))
    assert len(set(domain.feature_names)) == len(domain.feature_names)
    assert len(set(tasks.names)) == 4
    assert skills.shape[0] == 2
    assert np.isfinite(skills).any(axis=1).all()
    assert success.shape == (2, 4, DRAWS)
    assert success.dtype == np.bool_
    assert all(0 <= done <= total for done, total in seen)
    assert seen == sorted(seen)


def test_a_skill_can_be_looked_at(collected):
    domain, tasks, skills, *_ = collected
    views = [domain.view(skills[row], tasks.take([task]), np.random.default_rng(3)) for row, task in ((0, 0), (1, 3))]
    assert [view.name for view in views] == [tasks.names[0], tasks.names[3]]
    first = strategy_figure(views, domain.name)
    assert first[:8] == b"\x89PNG\r\n\x1a\n"
    assert first == strategy_figure(views, domain.name)


def test_equal_generators_give_equal_tasks_and_outcomes(collected):
    domain, tasks, skills, success, _ = collected
    again = domain.sample_tasks(np.random.default_rng(0), 4)
    assert again.names == tasks.names
    assert_array_equal(again.features, tasks.features)
    repeated = domain.evaluate(skills, tasks.take([0, 3]), tasks, DRAWS, np.random.default_rng(2))
    assert_array_equal(repeated, success)


def test_a_set_of_tasks_has_the_same_features(collected):
    domain, tasks, *_ = collected
    day = domain.sample_set(np.random.default_rng(5), 3)
    assert len(day) == 3
    assert day.features.shape[1] == tasks.features.shape[1]
    assert set(day.payload) == set(tasks.payload)


def test_unknown_names_and_parameters_are_refused():
    with pytest.raises(ConfigError, match="lego"):
        make_domain("chess")
    with pytest.raises(ConfigError, match="tap_noise"):
        make_domain("lego", {"tap_niose": 1.0})
    with pytest.raises(ConfigError, match="already"):
        DOMAINS.register("lego", "elsewhere:Lego")
    with pytest.raises(ConfigError, match="is no target"):
        DOMAINS.register("new", "elsewhere")


def test_lego_does_not_load_the_physics_engine():
    code = "import sys; from p2l.domains.table import make_domain; make_domain('lego'); print('mujoco' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_tasks_are_checked_and_frozen():
    features = np.arange(6.0).reshape(3, 2)
    tasks = Tasks(("a", "b", "c"), features, np.zeros(3, dtype=int), {"x": np.arange(3)})
    taken = tasks.take([2, 0, 2])
    assert taken.names == ("c", "a", "c")
    assert_array_equal(taken.payload["x"], [2, 0, 2])
    assert_array_equal(taken.features, features[[2, 0, 2]])
    with pytest.raises(ValueError, match="read-only"):
        tasks.features[0, 0] = 1.0
    with pytest.raises(ShapeError, match="payload 'x'"):
        Tasks(("a", "b", "c"), features, np.zeros(3, dtype=int), {"x": np.arange(2)})
    with pytest.raises(ShapeError, match="features"):
        Tasks(("a", "b", "c"), features * np.nan, np.zeros(3, dtype=int))
