"""Failure modes: the same as scikit-learn's mixture, numbered by size, and sensible where there is little to group."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.mixture import GaussianMixture

from p2l.contracts.observation import Observation, Privileged
from p2l.errors import ArtifactError, ConfigError, ShapeError
from p2l.failures.classifier import ModeClassifier, default_fields, features, load_modes, save_modes
from p2l.failures.clustering import ClusterOptions, cluster, typical
from tests.failures.pushing import found

CENTRES = np.array([[-0.2, 0.0, 0.0], [0.1, 0.1, 0.0], [0.0, -0.3, 0.05]])
SIZES = (9, 30, 18)


@pytest.fixture(scope="module")
def pushed():
    world, _, made = found("pessimistic", sigma_m=0.03, episodes=60)
    return world, made.failures


@pytest.fixture(scope="module")
def blobs(pushed):
    """Push failures moved so that the hand is at one of three places from the block."""
    world, failures = pushed
    rng = np.random.default_rng(0)
    label = np.repeat(np.arange(3), SIZES)
    some = failures.take(rng.integers(len(failures), size=len(label)))
    away = CENTRES[label] + rng.normal(0.0, 0.01, (len(label), 3))
    block = some.truth["block_pos_m"]
    return (
        world,
        dataclasses.replace(some, truth=Privileged.of({"grip_pos_m": block + away, "block_pos_m": block})),
        label,
    )


def options(modes=3, **changes):
    return ClusterOptions(**{"modes": modes, "max_modes": 6, "restarts": 3} | changes)


@pytest.mark.parametrize("covariance", ["full", "tied", "diag", "spherical"])
@pytest.mark.parametrize("modes", [3, None])
def test_known_groups_are_found_and_numbered_by_size(blobs, modes, covariance):
    world, failures, label = blobs
    made = cluster(world, failures, options(modes, covariance=covariance), seed=1)
    if modes:
        assert made.modes.sizes.tolist() == sorted(SIZES, reverse=True)
        assert_array_equal(made.mode, np.array([2, 0, 1])[label])
        assert_allclose(made.modes.share, np.sort(SIZES)[::-1] / sum(SIZES))
        assert (made.probability > 0.99).all()
    assert_array_equal(np.bincount(made.mode), made.modes.sizes)
    assert (np.diff(made.modes.sizes) <= 0).all()


def test_bic_chooses_the_number(blobs):
    world, failures, _ = blobs
    made = cluster(world, failures, options(None), seed=1)
    assert sorted(made.bic) == [1, 2, 3, 4, 5, 6]
    assert len(made.modes) == min(made.bic, key=made.bic.__getitem__) == 3


def test_the_classifier_is_the_mixture(pushed):
    world, failures = pushed
    made = cluster(world, failures, options(4), seed=5)
    values = made.modes.features(failures.truth)
    scaled = (values - values.mean(axis=0)) / values.std(axis=0)
    mixture = GaussianMixture(4, reg_covar=0.01, n_init=3, max_iter=500, random_state=5).fit(scaled)
    expected = np.sort(mixture.predict_proba(scaled), axis=1)
    assert_allclose(np.sort(made.modes.probability(failures.truth), axis=1), expected, atol=1e-9)


def test_the_seed_decides_all(pushed):
    world, failures = pushed
    first, second = (cluster(world, failures, options(4), seed=5) for _ in range(2))
    assert_array_equal(first.mode, second.mode)
    assert_array_equal(first.modes.means, second.modes.means)


def test_a_saved_classifier_says_the_same_of_anyone_who_knows_its_fields(blobs, tmp_path):
    world, failures, _ = blobs
    made = cluster(world, failures, options(), seed=1)
    save_modes(tmp_path / "modes.npz", made.modes)
    loaded = load_modes(tmp_path / "modes.npz", world)
    seen = Observation.of({name: failures.truth[name] for name in ("block_pos_m", "grip_pos_m")})
    assert_array_equal(loaded.probability(seen), made.modes.probability(failures.truth))
    with pytest.raises(ShapeError, match="no field 'grip_pos_m'"):
        loaded.classify(Observation.of({"block_pos_m": failures.truth["block_pos_m"]}))
    save_modes(tmp_path / "modes.npz", dataclasses.replace(made.modes, digest="0"))
    with pytest.raises(ArtifactError, match=r"run `python -m stages\.cluster` again"):
        load_modes(tmp_path / "modes.npz", world)


def test_the_typical_member_is_the_one_nearest_the_mean(blobs):
    world, failures, _ = blobs
    made = cluster(world, failures, options(), seed=1)
    for mode, member in enumerate(typical(made, failures)):
        mine = np.flatnonzero(made.mode == mode)
        scaled = (made.modes.features(failures.truth) - made.modes.centre) / made.modes.spread
        away = [np.linalg.norm(scaled[index] - made.modes.means[mode]) for index in mine]
        assert member == mine[int(np.argmin(away))]


def test_too_few_failures_say_what_to_do(pushed):
    world, failures = pushed
    with pytest.raises(ArtifactError, match=r"no failure in 60 executions of 'push' \(pessimistic\).*more executions"):
        cluster(world, failures.take([]), options(), seed=0)
    with pytest.raises(ConfigError, match=r"2 failures .* cannot make 3 modes; ask for at most 2, let BIC choose"):
        cluster(world, failures.take([0, 1]), options(), seed=0)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("modes", [None, 1])
def test_few_failures_are_grouped_all_the_same(pushed, count, modes):
    world, failures = pushed
    made = cluster(world, failures.take(np.arange(count)), options(modes), seed=0)
    assert made.modes.sizes.sum() == count
    assert np.isfinite(made.modes.probability(failures.truth)).all()


def test_a_mode_may_have_one_member(blobs):
    world, failures, label = blobs
    kept = np.append(np.flatnonzero(label == 1), np.flatnonzero(label == 2)[0])
    made = cluster(world, failures.take(kept), options(2), seed=0)
    assert made.modes.sizes.tolist() == [30, 1]
    assert typical(made, failures.take(kept))[1] == 30


def test_copies_of_one_failure_are_one_mode(pushed):
    world, failures = pushed
    made = cluster(world, failures.take(np.zeros(12, dtype=int)), options(4), seed=0)
    assert made.modes.sizes.tolist() == [12]
    assert_array_equal(made.mode, 0)


def test_features_are_fields_and_differences_with_names():
    known = Privileged.of({"grip_pos_m": np.ones((2, 3)), "box_pos_m": np.zeros((2, 3)), "gap_m": [1.0, 2.0]})
    assert default_fields(known) == ("grip_pos_m - box_pos_m", "gap_m")
    columns, values = features(known, default_fields(known))
    assert columns == ("grip from box_m[0]", "grip from box_m[1]", "grip from box_m[2]", "gap_m")
    assert_array_equal(values, [[1, 1, 1, 1], [1, 1, 1, 2]])
    with pytest.raises(ShapeError, match="'gap_m - box_pos_m': 1 columns minus 3"):
        features(known, ("gap_m - box_pos_m",))


def test_shapes_are_checked():
    with pytest.raises(ShapeError, match="means"):
        ModeClassifier(
            "push", "0", "pessimistic", (), ("a",), np.zeros(1), np.ones(1), np.ones(1), np.ones((2, 1)),
            np.ones((1, 1, 1)), np.array([3]),
        )  # fmt: skip
