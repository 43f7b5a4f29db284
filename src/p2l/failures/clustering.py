"""Failures grouped into modes by a Gaussian mixture (thesis, section 4.3.1; scikit-learn as in section 4.4.1).

Where the thesis is silent:
1. Features are the world's (`World.mode_fields`), standardised, since lengths and angles share no unit. A feature that
   does not vary is divided by 1.
2. `regularisation` is added to the variances of standardised features: 0.01 keeps a mode from being narrower than a
   tenth of a feature's spread, so that copies of one state are no mode of their own.
3. A mixture's component that is nobody's most probable one is no mode; the others share its weight.
4. Modes are numbered by size, largest first; equal ones by their mean, column by column.

Axis letters: N failures, F features, K modes.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np
from sklearn.mixture import GaussianMixture
from threadpoolctl import threadpool_limits

from p2l.contracts.world import World
from p2l.errors import ArtifactError, ConfigError
from p2l.failures.classifier import ModeClassifier, default_fields, features
from p2l.failures.record import Failures
from p2l.records import Array, IntArray

Covariance = Literal["full", "tied", "diag", "spherical"]


@dataclass(frozen=True)
class ClusterOptions:
    """How modes are fitted.

    Attributes:
        modes: their number, or None to choose it by BIC.
        max_modes: largest number that BIC may choose.
        covariance: shape of the components.
        regularisation: added to the variances of standardised features.
        restarts: fits from different starts, of which the likeliest stays.
    """

    modes: int | None
    max_modes: int
    covariance: Covariance = "full"
    regularisation: float = 0.01
    restarts: int = 10


@dataclass(frozen=True)
class Clustering:
    """Modes of a set of failures.

    Attributes:
        modes: the classifier.
        mode: [N] of the failures it was fitted to.
        probability: [N] of that mode.
        bic: by number of modes tried; the smallest is best.
    """

    modes: ModeClassifier
    mode: IntArray
    probability: Array
    bic: dict[int, float]


def cluster(world: World, failures: Failures, options: ClusterOptions, seed: int) -> Clustering:
    """Group failures.

    Args:
        world: where they happened.
        failures: training failures.
        options: how.
        seed: of the starts of the fits, below 2³².

    Raises:
        ArtifactError: there is no failure.
        ConfigError: fewer failures than modes.
    """
    _check(failures, options)
    fields = tuple(world.mode_fields) or default_fields(failures.truth)
    columns, values = features(failures.truth, fields)
    centre, spread = values.mean(axis=0), values.std(axis=0)
    spread[spread < 1e-9] = 1.0
    zscores = (values - centre) / spread
    numbers = [options.modes] if options.modes else range(1, min(options.max_modes, len(failures)) + 1)
    fits = {number: _fit(zscores, number, options, seed) for number in numbers}
    bic = {number: float(fit.bic(zscores)) for number, fit in fits.items()}
    fit = fits[min(bic, key=bic.__getitem__)]
    mode = fit.predict(zscores)
    order, sizes = _by_size(mode, fit.means_)
    modes = ModeClassifier(
        world=world.name,
        digest=world.digest,
        strategy=failures.origin.strategy,
        fields=fields,
        columns=columns,
        centre=centre,
        spread=spread,
        weights=fit.weights_[order] / fit.weights_[order].sum(),
        means=fit.means_[order],
        covariances=_full(fit)[order],
        sizes=sizes,
    )
    return Clustering(modes, *modes.classify(failures.truth), bic)


def typical(clustering: Clustering, failures: Failures) -> IntArray:
    """[K] index of the member nearest to each mode's mean, in standardised features; ties go to the first."""
    modes = clustering.modes
    zscores = (modes.features(failures.truth) - modes.centre) / modes.spread
    away = np.linalg.norm(zscores[:, None] - modes.means, axis=2)
    away[clustering.mode[:, None] != np.arange(len(modes))] = np.inf
    return np.asarray(away.argmin(axis=0))


def _check(failures: Failures, options: ClusterOptions) -> None:
    executions = f"{failures.origin.executions} executions of '{failures.origin.world}' ({failures.origin.strategy})"
    if not len(failures):
        raise ArtifactError(
            f"no failure in {executions}: there is nothing to group. Discover with more executions, or more noise "
            "(`world.params.sigma_m`)"
        )
    if options.modes and options.modes > len(failures):
        raise ConfigError(
            f"{len(failures)} failures in {executions} cannot make {options.modes} modes; ask for at most "
            f"{len(failures)}, let BIC choose (null), or discover with more executions"
        )


def _fit(zscores: Array, number: int, options: ClusterOptions, seed: int) -> GaussianMixture:
    mixture = GaussianMixture(
        number,
        covariance_type=options.covariance,
        reg_covar=options.regularisation,
        n_init=options.restarts,
        max_iter=500,
        random_state=seed,
    )
    # One thread: the matrices are small, and sums do not depend on the machine's number of cores.
    with warnings.catch_warnings(), threadpool_limits(1):
        warnings.filterwarnings("ignore", "Number of distinct clusters")  # what they leave empty is no mode
        return mixture.fit(zscores if len(zscores) > 1 else np.repeat(zscores, 2, axis=0))


def _by_size(mode: IntArray, means: Array) -> tuple[IntArray, IntArray]:
    """Components with members, in the order of the modes, and their sizes."""
    sizes = np.bincount(mode, minlength=len(means))
    keys = [(-size, *mean) for size, mean in zip(sizes.tolist(), means.tolist(), strict=True)]
    order = [place for place in sorted(range(len(means)), key=keys.__getitem__) if sizes[place]]
    return np.array(order, dtype=np.int64), sizes[order]


def _full(fit: GaussianMixture) -> Array:
    """[K, F, F] whatever the mixture's own form."""
    count, size = fit.means_.shape
    if fit.covariance_type == "full":
        return np.asarray(fit.covariances_)
    if fit.covariance_type == "tied":
        return np.tile(fit.covariances_, (count, 1, 1))
    variances = np.broadcast_to(np.reshape(fit.covariances_, (count, -1)), (count, size))
    return np.asarray(variances[:, :, None] * np.eye(size))
