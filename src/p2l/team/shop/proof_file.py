"""The proof of a shop's plan as a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from p2l.artifacts import load_arrays
from p2l.errors import ArtifactError, ShapeError
from p2l.team.proof_arrays import from_arrays, to_arrays
from p2l.team.shop.record import ShopCertificate

PROOF = "certificate.npz"


def proof_arrays(proof: ShopCertificate) -> dict[str, Any]:
    """A proof as the arrays of `certificate.npz`."""
    arrays: dict[str, Any] = {name: np.asarray(getattr(proof, name)) for name in ("parent", "lesson", "group")}
    for number, leaf in enumerate(proof.leaf):
        if leaf is not None:
            arrays |= to_arrays(leaf, f"{number}/")
    return arrays


def read_proof(path: Path) -> ShopCertificate | None:
    """The proof in `certificate.npz`; None if there is no such file.

    Raises:
        ArtifactError: damaged, or no certificate.
    """
    if not path.is_file():
        return None
    arrays = load_arrays(path, schema="shop_certificate", version=1)
    try:
        numbers = range(len(arrays["parent"]))
        leaves = tuple(from_arrays(arrays, f"{n}/") if f"{n}/target" in arrays else None for n in numbers)
        return ShopCertificate(arrays["parent"], arrays["lesson"], arrays["group"], leaves)
    except (KeyError, TypeError, ValueError, ShapeError) as error:
        raise ArtifactError(f"{path}: is no certificate ({error}); plan again") from error
