"""A recovery policy that stands alone: weights in safetensors, everything else in a JSON card, no learner needed.

The card names the world, the columns and the actions of the policy; where one of them differs the policy is refused,
since an index would silently mean something else. A world with other parameters (another arm, another
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
ABSENT = "absent.json"  # beside a card without weights
CLIP = 10.0  # standardised observations beyond it are cut, as SB3 does
NARROWEST = 0.05  # m, rad or 1: what hardly varies among failures may vary during recovery
Weights = Mapping[str, torch.Tensor]


@dataclass(frozen=True)
class Normalisation:
    """Standardisation of observations: `centre` and `scale`, [O] each.

    `narrowest` is the least scale, also of statistics that go on from these; a policy's card holds none of it.
    """

    centre: Array
    scale: Array
    narrowest: float = NARROWEST

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name in ("centre", "scale"):
            object.__setattr__(self, name, freeze(name, getattr(self, name), ("O",), sizes))

    @classmethod
    def of(cls, observations: Array, narrowest: float = NARROWEST) -> Normalisation:
        """Mean and standard deviation of [K, O], the latter at least `narrowest`."""
        return cls(observations.mean(axis=0), np.maximum(observations.std(axis=0), narrowest), narrowest)


@dataclass(frozen=True)
class Card:
    """Metadata of a policy, which give its weights their meaning.

    Attributes:
        world: registered name.
        digest: of the world of its training.
        learner: registered name.
        seed: of the run.
        config_hash: of the run.
        columns: O names.
        actions: A names.
        limits: bounds of an episode.
        normalisation: of the columns.
        whole_task: it acts from the start of the task, not from a failure.
        preconditions: it hands over where preconditions hold; their file lies beside the card.
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
        plain = {name: getattr(self, name) for name in ("world", "learner", "seed", "config_hash")}
        plain |= {"world_digest": self.digest, "columns": list(self.columns), "actions": list(self.actions)}
        scale = {"centre": self.normalisation.centre.tolist(), "scale": self.normalisation.scale.tolist()}
        plain |= {"limits": asdict(self.limits), "normalisation": scale, "told": dict(self.told)}
        plain |= {"whole_task": self.whole_task, "preconditions": self.preconditions}
        return plain | {"activation": "tanh", "clip": CLIP}

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> Card:
        """From what `plain` gave."""
        scale = plain["normalisation"]
        return cls(
            world=plain["world"],
            digest=plain["world_digest"],
            learner=plain["learner"],
            seed=plain["seed"],
            config_hash=plain["config_hash"],
            columns=tuple(plain["columns"]),
            actions=tuple(plain["actions"]),
            limits=Limits(**{**plain["limits"], "fields": tuple(plain["limits"]["fields"])}),
            normalisation=Normalisation(np.array(scale["centre"]), np.array(scale["scale"])),
            whole_task=plain["whole_task"],
            preconditions=plain["preconditions"],
            told=plain["told"],
        )


@dataclass(frozen=True)
class Policy:
    """A network from observations to actions.

    Attributes:
        card: metadata of the weights.
        weights: w0, b0, w1, b1 … of its layers, the last one linear; empty where only the card is left.
        identity: of the policy without weights, its `policy_hash`.
    """

    card: Card
    weights: Weights
    identity: str = ""

    def logits(self, observation: Array) -> torch.Tensor:
        """[K, A] of [K, O].

        Raises:
            ShapeError: another number of columns, or NaN.
            ArtifactError: there are no weights.
        """
        if not self.weights:
            card = self.card
            raise ArtifactError(
                f"{card.learner}, seed {card.seed}, in world '{card.world}': only the card and what the policy was "
                "judged by were kept, not its weights. To have them, learn it again with `python -m "
                f"stages.chain_recoveries`, learner={card.learner} seed={card.seed} records=null"
            )
        values = freeze("observation", observation, ("K", "O"), {"O": len(self.card.columns)})
        scale = self.card.normalisation
        centre, spread = (torch.tensor(part, dtype=torch.float32) for part in (scale.centre, scale.scale))
        activation = ((torch.tensor(values, dtype=torch.float32) - centre) / spread).clamp(-CLIP, CLIP)
        layers = len(self.weights) // 2
        for layer in range(layers):
            weight, bias = self.weights[f"w{layer}"].float(), self.weights[f"b{layer}"].float()
            activation = functional.linear(activation, weight, bias)
            activation = torch.tanh(activation) if layer < layers - 1 else activation
        return activation

    def act(self, observation: Array) -> IntArray:
        """[K] the most probable action."""
        with torch.no_grad():
            return np.asarray(self.logits(observation).argmax(dim=1).numpy(), dtype=np.int64)


def save_policy(folder: Path, policy: Policy) -> None:
    """Write `policy.safetensors` and `policy.safetensors.json`."""
    save_network(folder / FILE, dict(policy.weights), policy.card.plain(), schema=SCHEMA)


def save_absent(folder: Path, policy: Policy) -> None:
    """Write the identity of a policy beside a card without weights."""
    save_json(folder / ABSENT, {"policy": policy.identity}, schema="absent_policy", version=1)


def load_policy(folder: Path, *, identity: str | None = None) -> Policy:
    """Read a policy, for whatever world.

    Args:
        folder: of the policy.
        identity: its `policy_hash`, if known; a card without weights then needs no file of its identity.

    Raises:
        ArtifactError: missing or damaged.

    Example:
        >>> from pathlib import Path
        >>> from p2l import load_policy
        >>> policy = load_policy(Path("results/thesis/records/policies/pick_place-search-s0"))
        >>> policy.card.world, policy.card.learner, policy.card.actions[-1]
        ('pick_place', 'search', 'from place')
    """
    if absent := not (folder / FILE).is_file() and _card_file(folder).is_file():
        if identity is None:
            if not (folder / ABSENT).is_file():
                raise ArtifactError(
                    f"{folder / FILE}: missing beside its card; put it back, or learn the policy again with "
                    "`python -m stages.chain_recoveries`"
                )
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
    """Identity of a policy: the hash of its card and its weights."""
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
    """Refuse a policy of another world, other columns or other actions.

    Args:
        policy: as loaded.
        where: its folder, for the message.
        world: registered name of the world in which it is to act.
        digest: of that world.
        columns: of that world.
        actions: of that world.
        transfer: accept another version of the same world.

    Raises:
        ArtifactError: the world, its columns or its actions differ.
    """
    card = policy.card
    if card.world != world:
        raise ArtifactError(f"{where}: a policy for world '{card.world}'; this is '{world}'")
    for what, card_names, world_names in (("actions", card.actions, actions), ("columns", card.columns, columns)):
        if tuple(card_names) != tuple(world_names):
            raise ArtifactError(
                f"{where}: a policy of '{world}' with {len(card_names)} {what} ({_first(card_names, world_names)}); "
                f"this world has {len(world_names)} ({_first(world_names, card_names)})"
            )
    if card.digest != digest and not transfer:
        raise ArtifactError(
            f"{where}: learnt in world '{world}' with other parameters or code (digest {card.digest}, this one's is "
            f"{digest}); name those of its training (world.params.…), train it in this world, or let it act where it "
            "did not learn: transfer.variants of `evaluate_chains`, transfer=true of `watch`"
        )


def _first(one: Sequence[str], other: Sequence[str]) -> str:
    """What `one` has and `other` lacks, for a message."""
    lacking = [name for name in one if name not in other]
    return "all of the other's" if not lacking else ", ".join(lacking[:3]) + (" …" if len(lacking) > 3 else "")
