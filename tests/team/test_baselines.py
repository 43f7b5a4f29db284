import numpy as np
import pytest

from p2l.errors import ConfigError
from p2l.team import Decision
from p2l.team.baselines import act_delegate, act_learn_myopic, best_theta, confidence_based
from tests.team.team_instances import thesis_set

A, D, L = Decision.ACT, Decision.DELEGATE, Decision.LEARN


def chain():
    """Lesson 0 helps task 1 (0.6) and task 2 (0.3); lesson 2 helps task 3 (0.9)."""
    transfer = np.zeros((4, 4))
    transfer[0, 1], transfer[0, 2], transfer[2, 3] = 0.6, 0.3, 0.9
    return transfer


def test_ad_compares_an_attempt_with_the_person():
    problem = thesis_set(3, pretrained=0.0)
    assert act_delegate(problem).tolist() == [D, D, D]
    assert act_delegate(thesis_set(3, pretrained=0.2)).tolist() == [A, A, A]  # 10 + 80 < 100


def test_cba_learns_below_its_threshold_and_uses_what_it_learnt():
    assert confidence_based(thesis_set(4, chain()), 0.5).tolist() == [L, A, L, A]
    assert confidence_based(thesis_set(4, chain()), 0.2).tolist() == [L, A, A, L]  # task 3 was only helped by lesson 2
    assert confidence_based(thesis_set(4, chain()), 0.95).tolist() == [L, L, L, L]


def test_cba_asks_at_the_threshold_itself():
    assert confidence_based(thesis_set(1, pretrained=0.5), 0.5).tolist() == [L]
    assert confidence_based(thesis_set(1, pretrained=0.5), 0.49).tolist() == [A]


def test_alm_learns_only_where_that_is_cheaper_at_once():
    assert act_learn_myopic(thesis_set(4, chain())).tolist() == [A, A, A, A]  # 200 > 110
    assert act_learn_myopic(thesis_set(4, chain(), c_demo=100.0)).tolist() == [L, A, A, L]  # 100 < 110, 100 > 80


def test_the_grid_search_finds_the_threshold_of_the_cheapest_plans():
    # one lesson (200) saves nine failures, so a robot that learns once is cheapest: any θ below 0.7 does that
    transfer = np.full((10, 10), 0.7)
    theta, means = best_theta([thesis_set(10, transfer)], [0.0, 0.5, 0.8])
    assert theta == 0.0  # the first of equals
    assert means == pytest.approx([200 + 9 * 40, 200 + 9 * 40, 2000])


def test_the_grid_search_needs_something_to_search():
    with pytest.raises(ConfigError, match="at least one problem"):
        best_theta([])
    with pytest.raises(ConfigError, match=r"theta: -0\.1"):
        confidence_based(thesis_set(1), -0.1)
