"""A shop beside its plan, as it was read: `shop.npz`, from which a day goes on when the person's files have changed."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from p2l.artifacts import load_arrays, save_arrays
from p2l.errors import ArtifactError, ShapeError
from p2l.records import Array
from p2l.team.shop.record import Shop, ShopOrder

SHOP = "shop.npz"
_SCHEMA, _VERSION = "shop", 1
_ARRAYS = (
    "completes", "count", "c_hum", "c_rob", "c_fail", "pretrained", "c_demo", "transfer", "choice", "before",
)  # fmt: skip


@dataclass(frozen=True)
class SavedShop:
    """A shop, and what else a plan's files know of it.

    Attributes:
        shop: the day.
        trials: [R, L, n] attempts behind each transfer probability, 0 where nobody has counted any.
        extra: a person's own columns of the orders, as in `ShopReading`.
    """

    shop: Shop
    trials: Array
    extra: Mapping[str, tuple[str, ...]]


def save_shop(folder: Path | str, saved: SavedShop) -> None:
    """Write `shop.npz`."""
    shop = saved.shop
    names = {
        "tasks": shop.tasks,
        "robots": shop.robots,
        "lessons": shop.lessons,
        "order": shop.order,
        "extra": {name: list(cells) for name, cells in saved.extra.items()},
    }
    limits = np.array([shop.max_lessons, shop.max_teaching])
    arrays: dict[str, Any] = {name: getattr(shop, name) for name in _ARRAYS}
    text = np.frombuffer(json.dumps(names).encode(), np.uint8)
    content = {**arrays, "limits": limits, "trials": saved.trials, "names": text}
    save_arrays(Path(folder) / SHOP, content, schema=_SCHEMA, version=_VERSION)


def load_shop(folder: Path | str) -> SavedShop:
    """Read `shop.npz`.

    Raises:
        ArtifactError: missing, damaged, or no shop.
    """
    path = Path(folder) / SHOP
    if not path.is_file():
        raise ArtifactError(f"{path}: no such file; plan again with `python -m stages.plan tasks=… transfer=…`")
    arrays = load_arrays(path, schema=_SCHEMA, version=_VERSION)
    try:
        names = json.loads(arrays["names"].tobytes())
        most, time = (float(each) for each in arrays["limits"])
        if math.isnan(most + time):
            raise ValueError("its limits are no numbers")
        fields: dict[str, Any] = {name: arrays[name] for name in _ARRAYS}
        fields |= {name: tuple(map(str, names[name])) for name in ("tasks", "robots", "lessons")}
        order = cast(ShopOrder, names["order"])
        shop = Shop(**fields, order=order, max_lessons=most, max_teaching=time)
        extra = {str(name): tuple(map(str, cells)) for name, cells in names["extra"].items()}
        if arrays["trials"].shape != shop.transfer.shape:
            raise ValueError("its trials are of another shop")
        return SavedShop(shop, arrays["trials"], extra)
    except (KeyError, TypeError, ValueError, AttributeError, ShapeError) as error:
        raise ArtifactError(f"{path}: is no shop ({error}); plan again") from error
