"""A recovery policy that stands alone: weights in safetensors, everything else in a JSON card, no learner needed.

The card says in which world, on which columns and over which actions the policy was learnt; where one of them differs
it is refused, since an index would silently mean something else. A world with other parameters (another arm, another
object) is refused too unless the transfer is asked for.

Axis letters: K rows, O observation columns, A actions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from p2l.artifacts import config_hash, load_json, load_network, save_json, save_network
from p2l.chaining.mdp import Limits
from p2l.errors import ArtifactError, ShapeError
from p2l.records import Array, IntArray, freeze

SCHEMA = "recovery_policy"
FILE = "policy.safetensors"
ABSENT = "absent.json"  # beside a card whose weights were not kept
CLIP = 10.0  # standardised observations beyond it are cut, as SB3 does
NARROWEST = 0.05  # m, rad or 1: what hardly varies among failures may vary during recovery
Weights = Mapping[str, torch.Tensor]


@dataclass(frozen=True)
class Normalisation:
    """Standardisation of observations: `centre` and `scale`, [O] each."""

    centre: Array
    scale: Array

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name in ("centre", "scale"):
            object.__setattr__(self, name, freeze(name, getattr(self, name), ("O",), sizes))

    @classmethod
    def of(cls, observations: Array, narrowest: float = NARROWEST) -> Normalisation:
        """Mean and standard deviation of [K, O], the latter at least `narrowest`."""
        return cls(observations.mean(axis=0), np.maximum(observations.std(axis=0), narrowest))


@dataclass(frozen=True)
class Card:
    """What a policy's weights mean.

    Attributes:
        world: registered name.
        digest: of the world it was learnt in.
        learner: registered name.
        seed: of the run.
        config_hash: of the run.
        columns: O names.
        actions: A names.
        limits: bounds of an episode.
        normalisation: of the columns.
        whole_task: it acts from the start of the task, not from a failure.
        preconditions: it hands over where learnt preconditions hold; they lie beside it.
        told: numbers for the reader: control steps, success at evaluation.
    """

    world: str
    digest: str
    learner: str
    seed: int
    config_hash: str
    columns: tuple[str, ...]
    actions: tuple[str, ...]
    limits: Limits
    normalisation: Normalisation
    whole_task: bool = False
    preconditions: bool = False
    told: Mapping[str, float] = field(default_factory=dict)

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        known = {name: getattr(self, name) for name in ("world", "learner", "seed", "config_hash")}
        known |= {"world_digest": self.digest, "columns": list(self.columns), "actions": list(self.actions)}
        scale = {"centre": self.normalisation.centre.tolist(), "scale": self.normalisation.scale.tolist()}
        known |= {"limits": asdict(self.limits), "normalisation": scale, "told": dict(self.told)}
        known |= {"whole_task": self.whole_task, "preconditions": self.preconditions}
        return known | {"activation": "tanh", "clip": CLIP}

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> Card:
        """From what `plain` gave."""
        return cls(
            world=plain["world"],
            digest=plain["world_digest"],
            learner=plain["learner"],
            seed=plain["seed"],
            config_hash=plain["config_hash"],
            columns=tuple(plain["columns"]),
            actions=tuple(plain["actions"]),
            limits=Limits(**{**plain["limits"], "fields": tuple(plain["limits"]["fields"])}),
            normalisation=Normalisation(**{name: np.array(value) for name, value in plain["normalisation"].items()}),
            whole_task=plain["whole_task"],
            preconditions=plain["preconditions"],
            told=plain["told"],
        )


@dataclass(frozen=True)
class Policy:
    """A network from observations to actions.

    Attributes:
        card: what the weights mean.
        weights: w0, b0, w1, b1 … of its layers, the last one linear; empty where only the card was kept.
        identity: of the policy without weights, its `policy_hash`.
    """

    card: Card
    weights: Weights
    identity: str = ""

    def logits(self, observation: Array) -> torch.Tensor:
        """[K, A] of [K, O].

        Raises:
            ShapeError: another number of columns, or NaN.
            ArtifactError: the weights were not kept.
        """
        if not self.weights:
            card = self.card
            raise ArtifactError(
                f"{card.learner}, seed {card.seed}, in world '{card.world}': only the card and what the policy was "
                "judged by were kept, not its weights. To have them, learn it again with `python -m "
                f"stages.chain_recoveries`, learner={card.learner} seed={card.seed} records=null"
            )
        given = freeze("observation", observation, ("K", "O"), {"O": len(self.card.columns)})
        scale = self.card.normalisation
        centre, spread = (torch.tensor(part, dtype=torch.float32) for part in (scale.centre, scale.scale))
        hidden = ((torch.tensor(given, dtype=torch.float32) - centre) / spread).clamp(-CLIP, CLIP)
        layers = len(self.weights) // 2
        for layer in range(layers):
            weight, bias = self.weights[f"w{layer}"].float(), self.weights[f"b{layer}"].float()
            hidden = functional.linear(hidden, weight, bias)
            hidden = torch.tanh(hidden) if layer < layers - 1 else hidden
        return hidden

    def act(self, observation: Array) -> IntArray:
        """[K] the most probable action."""
        with torch.no_grad():
            return np.asarray(self.logits(observation).argmax(dim=1).numpy(), dtype=np.int64)


def save_policy(folder: Path, policy: Policy) -> None:
    """Write `policy.safetensors` and `policy.safetensors.json`."""
    save_network(folder / FILE, dict(policy.weights), policy.card.plain(), schema=SCHEMA)


def save_absent(folder: Path, policy: Policy) -> None:
    """Say beside a card whose weights were not kept which policy it is of."""
    save_json(folder / ABSENT, {"policy": policy.identity}, schema="absent_policy", version=1)


def load_policy(folder: Path, *, identity: str | None = None) -> Policy:
    """Read a policy, for whatever world.

    Args:
        folder: of the policy.
        identity: its `policy_hash`, from who knows it: then the card is enough where the weights were not kept.

    Raises:
        ArtifactError: missing or damaged.
    """
    if absent := not (folder / FILE).is_file() and _card_file(folder).is_file():
        if identity is None:
            identity = str(load_json(folder / ABSENT, schema="absent_policy", version=1)["policy"])
        weights: Weights = {}
        plain = load_json(_card_file(folder), schema=SCHEMA, version=1)
    else:
        weights, plain = load_network(folder / FILE, schema=SCHEMA)
    try:
        policy = Policy(Card.from_plain(plain), weights, identity or "")
    except (KeyError, TypeError, ShapeError) as error:
        raise ArtifactError(f"{_card_file(folder)}: not the card of a recovery policy ({error})") from error
    if absent:
        return policy
    ends = [weights["w0"].shape[1], weights[f"w{len(weights) // 2 - 1}"].shape[0]]
    if ends != [len(policy.card.columns), len(policy.card.actions)]:
        raise ArtifactError(
            f"{folder / FILE}: the network goes from {ends[0]} columns to {ends[1]} actions; see its card"
        )
    return policy


def policy_hash(policy: Policy) -> str:
    """Identifies a policy by what it does, and by where it was learnt."""
    if not policy.weights:
        return policy.identity
    weights = {name: tensor.tolist() for name, tensor in policy.weights.items()}
    return config_hash([policy.card.plain(), weights])


def _card_file(folder: Path) -> Path:
    return folder / f"{FILE}.json"


def check_policy(
    policy: Policy,
    where: Path,
    *,
    world: str,
    digest: str,
    columns: Sequence[str],
    actions: Sequence[str],
    transfer: bool = False,
) -> None:
    """Refuse a policy that was learnt for something else.

    Args:
        policy: as loaded.
        where: its folder, for the message.
        world: registered name of where it is to act,
        digest: its digest,
        columns: its columns, and
        actions: its actions.
        transfer: another version of the same world is wanted.

    Raises:
        ArtifactError: the world, its columns or its actions differ.
    """
    card = policy.card
    if card.world != world:
        raise ArtifactError(f"{where}: a policy for world '{card.world}'; this is '{world}'")
    for what, given, wanted in (("actions", card.actions, actions), ("columns", card.columns, columns)):
        if tuple(given) != tuple(wanted):
            raise ArtifactError(
                f"{where}: a policy of '{world}' with {len(given)} {what} ({_first(given, wanted)}); "
                f"this world has {len(wanted)} ({_first(wanted, given)})"
            )
    if card.digest != digest and not transfer:
        raise ArtifactError(
            f"{where}: learnt in world '{world}' with other parameters or code ({card.digest}, not {digest}); train "
            "again, or watch it all the same with transfer=true"
        )


def _first(one: Sequence[str], other: Sequence[str]) -> str:
    """What `one` has and `other` lacks, for a message."""
    lacking = [name for name in one if name not in other]
    return "all of the other's" if not lacking else ", ".join(lacking[:3]) + (" …" if len(lacking) > 3 else "")
