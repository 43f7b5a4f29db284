"""Import and export of PPO's weights: checkpoints to resume from, and policies that need no learner."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from p2l.artifacts import part
from p2l.chaining.checkpoint import Progress
from p2l.chaining.policy import Card, Policy
from p2l.chaining.ppo import PoolPPO
from p2l.seeding import generator_state, restore_generator


def restore(model: PoolPPO, progress: Progress, rng: np.random.Generator) -> None:
    """Let a training go on from a checkpoint as if it had never stopped; `rng` draws the start states."""
    by_name = progress.tensors
    model.policy.load_state_dict({k.removeprefix("policy."): v for k, v in by_name.items() if k.startswith("policy.")})
    state = model.policy.optimizer.state_dict()
    state["state"] = {}
    for key, value in by_name.items():
        if key.startswith("adam."):
            _, index, name = key.split(".")
            state["state"].setdefault(int(index), {})[name] = value
    model.policy.optimizer.load_state_dict(state)
    arrays = {key: value.numpy() for key, value in by_name.items()}
    model.pool.restore(part(arrays, "pool."))
    model.gatherer.restore(part(arrays, "gatherer."))
    if model.shortcut is not None:
        model.shortcut.restore(part(arrays, "shortcut."))
    model.num_timesteps = model.budget_steps
    restore_generator(rng, arrays["rng.starts"])
    torch.set_rng_state(by_name["rng.torch"])
    kind, key, place, has_gauss, gauss = json.loads(arrays["rng.numpy"].tobytes())
    np.random.set_state((kind, np.array(key, dtype=np.uint32), place, has_gauss, gauss))  # noqa: NPY002 (SB3 draws from it)


def tensors(model: PoolPPO, rng: np.random.Generator) -> dict[str, torch.Tensor]:
    """Everything that decides a training's future by name, for `restore`."""
    by_name = {f"policy.{name}": value.clone() for name, value in model.policy.state_dict().items()}
    for index, state in model.policy.optimizer.state_dict()["state"].items():
        by_name |= {f"adam.{index}.{name}": torch.as_tensor(value).clone() for name, value in state.items()}
    arrays: dict[str, npt.NDArray[Any]] = {"rng.starts": generator_state(rng)}
    drawn: tuple[Any, ...] = np.random.get_state()  # type: ignore[assignment]  # noqa: NPY002
    plain = [drawn[0], drawn[1].tolist(), *drawn[2:]]
    arrays["rng.numpy"] = np.frombuffer(json.dumps(plain).encode(), dtype=np.uint8)  # SB3 draws minibatches from it
    arrays |= {f"pool.{name}": value for name, value in model.pool.state().items()}
    arrays |= {f"gatherer.{name}": value for name, value in model.gatherer.state().items()}
    if model.shortcut is not None:
        arrays |= {f"shortcut.{name}": value for name, value in model.shortcut.state().items()}
    by_name |= {name: torch.tensor(np.ascontiguousarray(value)) for name, value in arrays.items()}
    return by_name | {"rng.torch": torch.get_rng_state()}


def export_policy(model: PoolPPO, card: Card) -> Policy:
    """The actor alone, in half precision: evaluations use the policy of the file, and the file is half as large.

    Its card has the present normalisation, where that is a running one.
    """
    modules = dict(model.policy.named_modules())
    layers = [part for name, part in modules.items() if name.startswith("mlp_extractor.policy_net.")]
    layers = [part for part in (*layers, modules["action_net"]) if isinstance(part, torch.nn.Linear)]
    weights: dict[str, torch.Tensor] = {}
    for index, layer in enumerate(layers):
        weights |= {f"w{index}": layer.weight.detach().half(), f"b{index}": layer.bias.detach().half()}
    running = model.normalisation
    return Policy(card if running is None else replace(card, normalisation=running), weights)
