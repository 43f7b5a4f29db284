"""Recorded failures for a training run, checked against its configuration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from p2l.errors import ArtifactError
from p2l.failures.record import Failures, check_params, load_failures
from p2l.worlds.table import make_world


def recorded_failures(path: Path, item: str, world: str, params: Mapping[str, Any]) -> Failures:
    """Training failures of a world, checked against its parameters and its estimator.

    Args:
        path: file of `discover`.
        item: world, or a variant of it, for the message.
        world: name or target.
        params: of the world.

    Raises:
        ArtifactError: there are none, or they come from another world, variant or estimator.
    """
    if not path.exists():
        raise ArtifactError(
            f"{path}: no failures of '{item}' have been recorded. To discover some: `python -m stages.discover` with "
            f"the same world=… and its parameters, and hydra.run.dir={path.parent}; "
            f"for a world of the pipeline, `dvc repro discover@{item}`"
        )
    failures = load_failures(path, "train")
    check_params(failures, world, params, path)
    if params.get("estimator") != failures.origin.params.get("estimator"):
        # A mode that is left out may equal the one that is named.
        mode, own_mode = (make_world(world, each).estimator.mode for each in (params, failures.origin.params))
        if mode != own_mode:
            raise ArtifactError(
                f"{path}: found under estimator={own_mode}, the configuration says {mode}; say "
                f"world.params.estimator={own_mode} here and in evaluate_chains, or run `python -m stages.discover "
                f"world={item} estimator={mode}`"
            )
    return failures
