"""A recovery policy as ONNX, for robots that have neither torch nor this program.

The graph takes `observation` [K, O] (float32, columns as the card lists them) and gives `logits` [K, A] and `action`
[K]; standardisation is inside. A JSON card beside it says what columns and actions mean, and how an episode is bounded.

Axis letters: K rows, O observation columns, A actions.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from p2l.artifacts import atomic, digest_bytes, save_json
from p2l.chaining.policy import CLIP, Policy
from p2l.chaining.states import state_fields
from p2l.contracts.observation import Observation
from p2l.errors import ArtifactError, ConfigError
from p2l.failures.record import Failures
from p2l.records import Array
from p2l.seeding import generator

FILE = "policy.onnx"
OPSET, IR = 17, 9
TOLERANCE = 1e-4  # of a logit, relative to the largest: sums of float32 in another order
CHECKED = 1_000  # observations


@dataclass(frozen=True)
class ExportCheck:
    """How a file compares with the policy that it was made of.

    Attributes:
        observations: how many were compared, all of them recorded or drawn around recorded ones.
        recorded: distinct recorded ones among them.
        largest_difference: of a logit.
        same_actions: share of observations with the same action; others are ties within `TOLERANCE`.
    """

    observations: int
    recorded: int
    largest_difference: float
    same_actions: float


def recorded_states(policy: Policy, failures: Failures) -> Array:
    """[CHECKED, O] states at recorded failures; where there are fewer, the rest is drawn around them.

    Raises:
        ArtifactError: failures of another world, or whose observation lacks columns of the policy.
    """
    card = policy.card
    lacking = [name for name in card.limits.fields if name not in failures.seen.columns]
    if not lacking:
        states = Observation.stack([state_fields(failures.seen, card.limits)] * card.limits.history)
        lacking = [name for name in card.columns if name not in states.names]
    if lacking or states.names != card.columns:
        raise ArtifactError(
            f"failures of '{failures.origin.world}' have other columns than the policy of '{card.world}'"
            + (f"; they lack {', '.join(lacking[:3])}" if lacking else "")
        )
    values = states.values[:CHECKED]
    if len(values) == CHECKED:
        return values
    rng = generator(card.seed, "export", card.world)
    more = CHECKED - len(values)
    around = values[rng.integers(len(values), size=more)]
    return np.concatenate([values, around + card.normalisation.scale * rng.standard_normal((more, values.shape[1]))])


def export(folder: Path, policy: Policy, states: Array, recorded: int) -> ExportCheck:
    """Write `policy.onnx` and its card, once the file is seen to do what the policy does.

    Args:
        folder: to write to.
        policy: with its weights.
        states: [N, O] to compare on.
        recorded: how many of them are recorded ones.

    Raises:
        ArtifactError: the policy has no weights, or the file does not do what it does.
        ConfigError: onnx or onnxruntime is not installed.
    """
    model = _model(policy)
    check = _compare(policy, model, states, recorded)
    with atomic(folder / FILE) as temporary:
        temporary.write_bytes(model)
    card = policy.card.plain() | {"opset": OPSET, "inputs": ["observation"], "outputs": ["logits", "action"]}
    told = {**check.__dict__, "digest": digest_bytes(model)}
    save_json(folder / f"{FILE}.json", card | {"check": told}, schema="exported_policy", version=1)
    return check


def _model(policy: Policy) -> bytes:
    """The serialised graph."""
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ImportError as error:
        raise ConfigError(f"{error.name} is not installed: `pip install 'p2l[export]'`") from error
    if not policy.weights:
        policy.logits(np.zeros((1, len(policy.card.columns))))  # says what is missing
    scale = policy.card.normalisation
    constants = {"centre": scale.centre, "spread": scale.scale, "low": np.array(-CLIP), "high": np.array(CLIP)}
    weights = {name: tensor.float().numpy() for name, tensor in policy.weights.items()}
    tensors = [numpy_helper.from_array(np.asarray(v, dtype=np.float32), k) for k, v in (constants | weights).items()]
    nodes = [
        helper.make_node("Sub", ["observation", "centre"], ["centred"]),
        helper.make_node("Div", ["centred", "spread"], ["scaled"]),
        helper.make_node("Clip", ["scaled", "low", "high"], ["x0"]),
    ]
    layers = len(weights) // 2
    for layer in range(layers):
        last = layer == layers - 1
        out = "logits" if last else f"z{layer}"
        nodes.append(helper.make_node("Gemm", [f"x{layer}", f"w{layer}", f"b{layer}"], [out], transB=1))
        if not last:
            nodes.append(helper.make_node("Tanh", [out], [f"x{layer + 1}"]))
    nodes.append(helper.make_node("ArgMax", ["logits"], ["action"], axis=1, keepdims=0))
    card = policy.card
    graph = helper.make_graph(
        nodes,
        f"{card.world}-{card.learner}-s{card.seed}",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["K", len(card.columns)])],
        [
            helper.make_tensor_value_info("logits", TensorProto.FLOAT, ["K", len(card.actions)]),
            helper.make_tensor_value_info("action", TensorProto.INT64, ["K"]),
        ],
        tensors,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR, producer_name="p2l")
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def _compare(policy: Policy, model: bytes, states: Array, recorded: int) -> ExportCheck:
    try:
        import onnxruntime
    except ImportError as error:
        raise ConfigError(f"{error.name} is not installed: `pip install 'p2l[export]'`") from error
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    logits, action = session.run(None, {"observation": states.astype(np.float32)})
    wanted = policy.logits(states.astype(np.float32).astype(np.float64)).detach().numpy()
    difference, largest = np.abs(logits - wanted), max(1.0, float(np.abs(wanted).max()))
    chosen = wanted[np.arange(len(action)), action]
    if difference.max() > TOLERANCE * largest or (chosen < wanted.max(axis=1) - TOLERANCE * largest).any():
        raise ArtifactError(f"the exported policy differs from its original by {difference.max():.2g} in a logit")
    same = float((action == wanted.argmax(axis=1)).mean())
    return ExportCheck(len(states), recorded, float(difference.max()), same)
