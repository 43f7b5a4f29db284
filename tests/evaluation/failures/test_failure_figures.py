"""Tables and figures of failures: hand-made counts, units, and a picture for any number of modes."""

import numpy as np
import pytest

from p2l.evaluation.failures.figures import axes_of, column_label, feature_ranking, mode_figure
from p2l.evaluation.failures.tables import (
    by_option,
    cluster_summary,
    discovery_metrics,
    first_kind,
    mode_table,
    split_summary,
)
from p2l.evaluation.style import png
from p2l.failures.clustering import ClusterOptions, cluster, typical
from tests.failures.pushing import found


@pytest.fixture(scope="module")
def pushed():
    return found("pessimistic", sigma_m=0.03, episodes=40)


def test_a_summary_counts_every_episode_once(pushed):
    _, _, made = pushed
    told = split_summary(made)
    successes = int(made.execution.success.sum())
    assert told["executions"] == told["success"]["trials"] == 40
    assert told["success"]["mean"] == successes / 40
    assert told["success"]["low"] < told["success"]["mean"] < told["success"]["high"]
    assert successes + told["failing_episodes"] + told["unrecorded_failing_episodes"] == 40
    assert sum(told["first_kind"].values()) == told["failing_episodes"]
    assert sum(option["failures"] for option in told["by_option"].values()) == told["failures"] == len(made.failures)
    metrics = discovery_metrics({"train": told, "held_out": told, "episodes_per_s": 2.0, "control_steps_per_s": 9.0})
    assert metrics["held_out/success"] == told["success"]["mean"]


def test_diverged_episodes_are_counted_apart(pushed):
    _, _, made = pushed
    made.execution.diverged[np.flatnonzero(~made.execution.success)[:3]] = True
    told = split_summary(made)
    made.execution.diverged[:] = False
    assert (told["diverged"], told["success"]["trials"]) == (3, 37)


def test_the_first_failure_of_an_episode_is_its_kind(pushed):
    _, _, made = pushed
    few = made.failures.take([0, 1, 0])
    changed = type(few)(**{**vars(few), "episode": [5, 5, 7], "step": [9, 4, 1], "kind": [0, 1, 0]})
    assert first_kind(changed) == {"stranded": 1, "missed": 1}
    shares = by_option(type(few)(**{**vars(few), "option": [0, 0, 1], "kind": [0, 1, 0]}))
    assert shares["align"] == {"failures": 2, "share": {"missed": 0.5, "stranded": 0.5}}
    assert shares["push"] == {"failures": 1, "share": {"missed": 1.0}}


@pytest.mark.parametrize("modes", [1, 2, 11])
def test_any_number_of_modes_is_tabled_and_drawn(pushed, modes):
    world, _, made = pushed
    failures = made.failures
    grouped = cluster(world, failures, ClusterOptions(modes, 12, restarts=1), seed=0)
    held_out = np.zeros(4, dtype=np.int64)
    table = mode_table(grouped, failures, held_out, typical(grouped, failures))
    assert table["size"].sum() == len(failures)
    assert table["weight"].sum() == pytest.approx(1.0)
    assert table["held_out"].tolist() == [4] + [0] * (len(table) - 1)
    for start in ("kind:", "option:"):
        shares = table[[name for name in table if name.startswith(start)]]
        assert shares.sum(axis=1).to_numpy() == pytest.approx(1.0)
    weighted = (table["mean:grip from block_m[1]"] * table["weight"]).sum()
    assert weighted == pytest.approx(grouped.modes.features(failures.truth)[:, 1].mean())
    first, second = (png(mode_figure(grouped, failures, table, "push")) for _ in range(2))
    assert first == second
    assert cluster_summary(grouped, failures, failures, table)["modes"][0]["mode"] == 0


@pytest.mark.parametrize(
    ("column", "label", "factor"),
    [
        ("grip in handle_m[1]", "grip in handle y, cm", 100.0),
        ("object_pos_m[2]", "object z, cm", 100.0),
        ("hinge_rad", "hinge, °", 180.0 / np.pi),
        ("force_n", "force, N", 1.0),
        ("turn_rad_s[0]", "turn x, rad/s", 1.0),
        ("arm_rad[5]", "arm[5], °", 180.0 / np.pi),
        ("held", "held", 1.0),
    ],
)
def test_columns_are_spoken_with_units(column, label, factor):
    assert column_label(column) == (label, pytest.approx(factor))


def test_telling_features_come_first_and_vectors_stay_together():
    mode = np.repeat([0, 1], 20)
    rng = np.random.default_rng(0)
    noise = rng.normal(size=40)
    outlier = np.where(np.arange(40) == 3, 1e3, 0.0)
    assert feature_ranking(np.stack([outlier, noise, mode + 0.01 * noise], axis=1), mode)[0] == 2
    assert axes_of(("a[0]", "a[1]", "b", "c"), [1, 2, 3, 0]) == [(0, 1), (2, 3)]
    assert axes_of(("a", "b"), [1, 0]) == [(0, 1), (1, 1)]
    assert axes_of(("a",), [0]) == [(0, 0), (0, 0)]
