"""What identifies failure modes and preconditions: records and recoveries belong to them."""

from __future__ import annotations

from p2l.artifacts import config_hash
from p2l.failures.classifier import ModeClassifier
from p2l.preconditions.record import Preconditions


def modes_hash(modes: ModeClassifier) -> str:
    """Identifies failure modes by the parameters of their classifier."""
    about = {name: getattr(modes, name) for name in ("world", "digest", "fields", "columns")}
    names = ("centre", "spread", "weights", "means", "covariances", "sizes")
    return config_hash(about | {name: getattr(modes, name).tolist() for name in names})


def preconditions_hash(preconditions: Preconditions) -> str:
    """Identifies preconditions by the parameters of their classifiers."""
    parts = [*(skill.arrays() for skill in preconditions.skills), preconditions.goal.arrays("goal.")]
    numbers = [{key: value.tolist() for key, value in part.items()} for part in parts]
    about = [preconditions.digest, preconditions.names, preconditions.threshold, preconditions.nominal.tolist()]
    return config_hash([*about, *numbers])
