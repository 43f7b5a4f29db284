"""Import and export of PPO's weights: checkpoints to resume from, and policies that need no learner."""

from __future__ import annotations

import torch

from p2l.chaining.checkpoint import Progress
from p2l.chaining.policy import Card, Policy
from p2l.chaining.ppo import PoolPPO


def restore(model: PoolPPO, progress: Progress) -> None:
    """Load weights, optimiser and control steps of a checkpoint."""
    by_name = progress.tensors
    model.policy.load_state_dict({k.removeprefix("policy."): v for k, v in by_name.items() if k.startswith("policy.")})
    state = model.policy.optimizer.state_dict()
    state["state"] = {}
    for key, value in by_name.items():
        if key.startswith("adam."):
            _, index, name = key.split(".")
            state["state"].setdefault(int(index), {})[name] = value
    model.policy.optimizer.load_state_dict(state)
    model.steps_before = model.num_timesteps = progress.control_steps
    if model.shortcut is not None:
        arrays = {key: value.numpy() for key, value in by_name.items() if key.startswith("shortcut.")}
        model.shortcut.restore({key.removeprefix("shortcut."): value for key, value in arrays.items()})


def tensors(model: PoolPPO) -> dict[str, torch.Tensor]:
    """Weights, optimiser and shortcut by name, for `restore`."""
    by_name = {f"policy.{name}": value.clone() for name, value in model.policy.state_dict().items()}
    for index, state in model.policy.optimizer.state_dict()["state"].items():
        by_name |= {f"adam.{index}.{name}": torch.as_tensor(value).clone() for name, value in state.items()}
    if model.shortcut is not None:
        by_name |= {f"shortcut.{name}": torch.tensor(value) for name, value in model.shortcut.state().items()}
    return by_name


def export_policy(model: PoolPPO, card: Card) -> Policy:
    """The actor alone, in half precision: evaluations use the policy of the file, and the file is half as large."""
    modules = dict(model.policy.named_modules())
    layers = [part for name, part in modules.items() if name.startswith("mlp_extractor.policy_net.")]
    layers = [part for part in (*layers, modules["action_net"]) if isinstance(part, torch.nn.Linear)]
    weights: dict[str, torch.Tensor] = {}
    for index, layer in enumerate(layers):
        weights |= {f"w{index}": layer.weight.detach().half(), f"b{index}": layer.bias.detach().half()}
    return Policy(card, weights)
