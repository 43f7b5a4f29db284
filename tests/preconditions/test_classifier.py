import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from p2l.artifacts import load_arrays, save_arrays
from p2l.errors import ConfigError, ShapeError
from p2l.preconditions.classifier import PreconditionClassifier, fit_classifier
from p2l.preconditions.mixture import Mixture, fit_gaussian

NAMES = ("x_m", "y_m", "yaw_rad")


def ball(rng, n, radius=1.0):
    """States around the origin; those nearer than `radius` are good."""
    states = rng.normal(size=(n, 3)) * 1.5
    return states, np.linalg.norm(states, axis=1) < radius


def fitted(n=600, seed=0, **settings):
    rng = np.random.default_rng(seed)
    return fit_classifier(*ball(rng, n), NAMES, rng, **settings)


@given(st.integers(1, 4), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_the_density_is_scipys(width, count, seed):
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(count, width, width))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(width)
    mixture = Mixture(rng.dirichlet(np.ones(count) * 5), rng.normal(size=(count, width)), covariances)
    states = rng.normal(size=(6, width))
    parts = zip(mixture.weights, mixture.means, covariances, strict=True)
    wanted = sum(w * stats.multivariate_normal(m, c).pdf(states) for w, m, c in parts)
    np.testing.assert_allclose(np.exp(mixture.log_density(states)), wanted, rtol=1e-8, atol=1e-300)


def test_the_positive_density_is_the_gaussian_of_the_positives():
    rng = np.random.default_rng(1)
    states, labels = ball(rng, 500)
    states = states * [1.0, 100.0, 0.01]
    good = states[labels]
    found = fit_classifier(states, labels, NAMES, rng, regularisation=1e-12)
    wanted = stats.multivariate_normal(good.mean(axis=0), np.cov(good.T))
    np.testing.assert_allclose(found.log_density(states), wanted.logpdf(states), rtol=1e-6)
    np.testing.assert_allclose(found.density(states), wanted.pdf(states), rtol=1e-5)


def test_the_probability_is_bayes_rule():
    found, states = fitted(), ball(np.random.default_rng(2), 50)[0]
    plus = found.prior * np.exp(found.positive.log_density(states))
    minus = (1 - found.prior) * np.exp(found.negative.log_density(states))
    np.testing.assert_allclose(found.probability(states), plus / (plus + minus))
    np.testing.assert_array_equal(found.holds(states), plus >= minus)


def test_one_feature_by_hand():
    """N(0, 1) against N(2, 1) with even odds: the log odds are 2 − 2x."""
    one = np.ones((1, 1, 1))
    found = PreconditionClassifier(
        ("x",), Mixture(np.ones(1), np.zeros((1, 1)), one), Mixture(np.ones(1), np.full((1, 1), 2.0), one), 0.5
    )
    np.testing.assert_allclose(found.logit(np.array([[0.0], [1.0], [3.0]])), [2.0, 0.0, -4.0])


def test_it_separates_what_it_has_not_seen():
    states, labels = ball(np.random.default_rng(3), 2000)
    assert (fitted(1200).holds(states) == labels).mean() > 0.9


def test_the_prior_is_the_share_of_positives_unless_given():
    labels = ball(np.random.default_rng(0), 600)[1]
    assert fitted().prior == labels.mean()
    assert fitted(prior=0.9).prior == 0.9


def test_units_change_the_density_by_their_product_and_the_probability_not_at_all():
    states, labels = ball(np.random.default_rng(4), 400)
    units = np.array([1000.0, 1.0, 0.02])
    one = fit_classifier(states, labels, NAMES, np.random.default_rng(0))
    other = fit_classifier(states * units, labels, NAMES, np.random.default_rng(0))
    np.testing.assert_allclose(other.probability(states * units), one.probability(states), atol=1e-6)
    np.testing.assert_allclose(other.log_density(states * units), one.log_density(states) - np.log(units).sum())


def test_far_away_is_negative_even_beyond_the_tails_of_the_negatives():
    """Negatives closer together than the positives: a plain ratio of tails calls all that is far away good."""
    rng = np.random.default_rng(5)
    states = np.concatenate([rng.normal(0.0, 1.0, (200, 2)), rng.normal(3.0, 0.1, (200, 2))])
    found = fit_classifier(states, np.arange(400) < 200, NAMES[:2], rng)
    far = np.array([[-30.0, 0.0], [0.0, 50.0], [-9.0, -9.0]])
    assert found.probability(far).max() < 1e-3
    assert found.holds(np.zeros((1, 2))).all()


@pytest.mark.parametrize("negatives", [0, 1])
def test_without_negatives_the_surroundings_of_the_positives_hold(negatives):
    rng = np.random.default_rng(6)
    states = np.concatenate([rng.normal(size=(200, 3)), np.full((negatives, 3), 2.0)])
    found = fit_classifier(states, np.arange(len(states)) < 200, NAMES, rng)
    assert found.prior == 0.5
    assert found.holds(states[:200]).mean() > 0.9
    assert not found.holds(np.full((1, 3), 4.0)).any()


def test_singular_covariances_and_few_samples_stay_usable():
    rng = np.random.default_rng(7)
    states = np.column_stack([rng.normal(size=40), np.full(40, 0.04), rng.normal(size=40)])
    states[:, 2] = 2 * states[:, 0]
    labels = np.abs(states[:, 0]) < 1
    for kept in (slice(None), np.r_[np.flatnonzero(labels)[:2], np.flatnonzero(~labels)[:3]]):
        found = fit_classifier(states[kept], labels[kept], NAMES, rng)
        assert np.isfinite(found.logit(states)).all()
        assert found.holds(states[kept][labels[kept]]).mean() > 0.7
    repeated = fit_classifier(np.repeat(states[:4], 20, axis=0), np.arange(80) < 40, NAMES, rng)
    assert np.isfinite(repeated.logit(states)).all()


def test_few_states_make_a_diagonal_gaussian():
    rng = np.random.default_rng(8)
    covariance = fit_gaussian(rng.normal(size=(7, 3)), 1e-4).covariances[0]
    assert np.count_nonzero(covariance) == 3
    assert np.count_nonzero(fit_gaussian(rng.normal(size=(8, 3)), 1e-4).covariances[0]) == 9


def test_samples_reach_into_the_vicinity():
    found, rng = fitted().positive, np.random.default_rng(9)
    near, wide = found.sample(rng, 20_000), found.sample(rng, 20_000, spread=2.0)
    np.testing.assert_allclose(near.mean(axis=0), found.means[0], atol=0.05)
    np.testing.assert_allclose(np.cov(near.T), found.covariances[0], atol=0.05)
    np.testing.assert_allclose(wide.std(axis=0) / near.std(axis=0), 2.0, rtol=0.05)


def test_it_survives_storage(tmp_path):
    found, states = fitted(), ball(np.random.default_rng(10), 20)[0]
    save_arrays(tmp_path / "rho.npz", found.arrays(), schema="precondition", version=1)
    back = PreconditionClassifier.from_arrays(load_arrays(tmp_path / "rho.npz", schema="precondition", version=1))
    np.testing.assert_array_equal(back.logit(states), found.logit(states))
    assert back.feature_names == NAMES


def test_the_same_generator_gives_the_same_classifier():
    for one, other in zip(fitted().arrays().values(), fitted().arrays().values(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_bad_input_is_refused():
    rng = np.random.default_rng(0)
    states, labels = ball(rng, 50)
    with pytest.raises(ConfigError, match="1 successful start states"):
        fit_classifier(states, np.arange(50) == 0, NAMES, rng)
    with pytest.raises(ConfigError, match="components 0"):
        fit_classifier(states, labels, NAMES, rng, components=0)
    with pytest.raises(ShapeError, match="prior"):
        fit_classifier(states, labels, NAMES, rng, prior=1.0)
    with pytest.raises(ShapeError, match="labels: axis 0"):
        fit_classifier(states, labels[:-1], NAMES, rng)
    with pytest.raises(ShapeError, match="states: axis 1"):
        fitted().probability(np.zeros((2, 4)))
    with pytest.raises(ShapeError, match="not positive definite"):
        Mixture(np.ones(1), np.zeros((1, 2)), np.ones((1, 2, 2)))
    with pytest.raises(ShapeError, match="sum 1"):
        Mixture(np.full(2, 0.4), np.zeros((2, 1)), np.ones((2, 1, 1)))
