"""What makes a finished run of the records the run that is asked for."""

from dataclasses import replace

import numpy as np
import pytest

from p2l.chaining.record import VERSION, VERSIONS, run_item
from tests.failures import pushing


@pytest.fixture(scope="module")
def failures():
    return pushing.found("first_flag")[2].failures


def nudged(failures):
    """The same failures as another processor may round them."""
    rows = failures.rows
    return replace(failures, rows=replace(rows, states=np.nextafter(rows.states, np.inf)))


def of_origin(failures, **changes):
    return replace(failures, origin=replace(failures.origin, **changes))


def entry(failures, config="config", code=""):
    return run_item("push", "rc", 0, config, failures, code)


def test_committed_records_outlive_another_processor_and_more_threads_but_no_other_failures(failures):
    first = entry(failures)
    assert entry(nudged(failures)) == first
    assert entry(of_origin(failures, params={**failures.origin.params, "nthread": 7})) == first
    more = {**failures.origin.params, "sigma_m": 0.07}
    for other in ({"seed": failures.origin.seed + 1}, {"executions": 7}, {"split": "held_out"}, {"params": more}):
        assert entry(of_origin(failures, **other)).config_hash != first.config_hash
    assert entry(failures, config="another").config_hash != first.config_hash


def test_a_learner_whose_code_has_changed_makes_records_of_its_own(failures):
    """Those of the others, hours of work, stay valid."""
    args = "push", "mine", 0, "config", failures, ""
    assert VERSIONS["search"] > VERSION
    assert run_item(*args, registered="rc") == run_item(*args)
    searched = run_item(*args, registered="search")
    assert searched.config_hash != run_item(*args).config_hash
    mixed = run_item(
        "push", "search_mixed", *args[2:], registered="search"
    )  # by its name: a search's records stay valid
    assert mixed.config_hash != searched.config_hash


def test_a_runs_own_records_know_failures_to_the_bit(failures):
    assert entry(failures, code="code") == entry(failures, code="code")
    assert entry(nudged(failures), code="code").config_hash != entry(failures, code="code").config_hash
