"""The small push world as the skill graph sees it, with preconditions by hand and recoveries that come back behind.

The state is how far the hand is past the starting line, and how far beside the block's middle, m. Push may start
within about 16 mm of the middle and 6 cm of 8 cm behind; align from anywhere behind.
"""

import numpy as np

from examples.push.skills import DOWN
from examples.push.world import Push
from p2l.failures.classifier import ModeClassifier
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.record import Recoveries, modes_hash, preconditions_hash
from p2l.metareskill.regression import ParameterisedSkill
from p2l.metareskill.target import RecoveryTask
from p2l.preconditions.classifier import PreconditionClassifier
from p2l.preconditions.mixture import Mixture
from p2l.preconditions.record import Preconditions
from p2l.skills.relative import SIZE, Timing
from p2l.worlds.table import WORLDS

NAMES = ("past_m", "beside_m")
TIMING = Timing((6, 6, 6), (0, 0, 2))


class Seen(Push):
    """Push, and the hand's orientation and the block's whole position are seen."""

    def _truth(self, rows):
        found = super()._truth(rows)
        return {**found, "block_y_m": found["block_pos_m"][:, 1:2], "grip_quat": self.read(rows, "grip_quat")}

    def _observation(self, rows, error):
        block = self.read(rows, "block_pos") + np.pad(error, ((0, 0), (1, 1)))
        return {**super()._observation(rows, error), "block_pos_m": block, "grip_quat": self.read(rows, "grip_quat")}

    def symbols(self):
        return PushSymbols()


class PushSymbols:
    """See `p2l.contracts.symbols.Symbols`."""

    names, context, far = NAMES, (0, 1), np.array([0.05, 0.02])

    def state(self, source):
        return np.column_stack([source["grip_pos_m"][:, 0], source["grip_pos_m"][:, 1] - source["block_y_m"][:, 0]])

    def hand(self, source, state):
        place = np.column_stack([state[:, 0], state[:, 1] + source["block_y_m"][:, 0], source["grip_pos_m"][:, 2]])
        return place, np.tile(DOWN, (len(state), 1))

    def fingers_closed(self, state):
        return np.zeros(len(state), dtype=np.bool_)


WORLDS.register("push_back", f"{__name__}:Seen")


def gaussian(mean, spread):
    return Mixture(np.ones(1), np.array([mean]), np.diag(np.square(spread))[None])


def preconditions(world):
    everywhere = gaussian((0.0, 0.0), (0.3, 0.05))
    align = PreconditionClassifier(NAMES, gaussian((-0.1, 0.0), (0.02, 0.06)), gaussian((0.0, 0.0), (0.3, 0.3)), 0.5)
    push = PreconditionClassifier(NAMES, gaussian((-0.08, 0.0), (0.02, 0.005)), everywhere, 0.5)
    goal = gaussian((0.12, 0.0), (0.01, 0.01))
    return Preconditions("push", world.digest, ("align", "push"), (align, push), goal, np.array([0.9, 0.9]))


def setting(**params):
    """World, task and nominal options."""
    world = Seen(**{"nthread": 1, "sigma_m": 0.03, "estimator": "halving", **params})
    return world, RecoveryTask(world, PushSymbols(), preconditions(world)), world.nominal_options()


def modes(world):
    """Two modes by the hand's place: to the left, to the right; the left one has three of four failures."""
    columns, means = tuple(f"grip_pos_m[{axis}]" for axis in range(3)), np.array([[0.1, 0.08, 0.0], [0.1, -0.08, 0.0]])
    return ModeClassifier(
        "push", world.digest, "pessimistic", ("grip_pos_m",), columns, np.zeros(3), np.ones(3),
        np.full(2, 0.5), means, np.tile(0.01 * np.eye(3), (2, 1, 1)), np.array([3, 1]),
    )  # fmt: skip


def recoveries(task, classifier, q):
    """Recoveries [2, 3] with success rates `q`; each goes back by 20 cm and a little to the side."""
    graph = SkillGraph(task.preconditions.nominal, classifier.sizes.astype(float), np.array(q))
    back = np.tile([-0.07, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0], 3) * np.repeat([1.0, 2.0, 3.0], 7)
    skill = ParameterisedSkill(np.zeros((1, 2)), back[None, :SIZE], np.zeros(2), np.ones(2))
    return Recoveries(
        "push", task.preconditions.digest, modes_hash(classifier), preconditions_hash(task.preconditions), graph,
        {(int(i), int(j)): skill for i, j in np.argwhere(graph.q > 0.0)}, TIMING,
    )  # fmt: skip


def standing(world, past_m, beside_m, *, done=False):
    """Rows with the hand so far past and beside the block; `done` puts the block behind the goal line."""
    past, beside = np.broadcast_arrays(np.atleast_1d(past_m), np.atleast_1d(beside_m))
    qpos = np.tile(world.engine.models[0].qpos0, (len(past), 1))
    qpos[:, 0] = 0.2 if done else 0.0
    qpos[:, 7], qpos[:, 8] = past, beside
    return world.rows(qpos, np.zeros((len(past), 12, 1)))
