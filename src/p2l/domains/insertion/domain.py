"""Learning to insert under uncertainty: the insertion and board domains of chapter 3.

A person demonstrates by touching the nearest wall, coming back by the distance they see, pressing lightly and
searching along the wall; REPS turns the demonstration into a skill that succeeds under the noise of the slot
estimate (thesis, figure 3.6 and section 3.5.1). Skills are six waypoints of a displacement and a stiffness.

Deviations from the thesis, each where it is silent:
1. REPS starts from that demonstration rather than from nothing; among equally near walls one is drawn at random.
2. Every sample of an update meets its own estimate error. The distribution whose mean succeeds most often in
   `validation_draws` further errors is kept, and a search ends when that rate reaches `solved_rate`.

Axis letters: K skills, M tasks, R noise draws, N rows, P = 24 parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from p2l.contracts.domain import Encoding, InsertionView, Progress, Tasks
from p2l.domains.insertion.demonstration import Demonstration
from p2l.domains.insertion.features import FEATURE_NAMES
from p2l.domains.insertion.layouts import (
    board_tasks,
    sample_board_tasks,
    sample_continuous_tasks,
    sample_grid_tasks,
)
from p2l.domains.insertion.physics import InsertionPhysics, is_inserted
from p2l.domains.insertion.rollouts import Rollouts
from p2l.domains.insertion.waypoints import WAYPOINTS
from p2l.records import Array, BoolArray, IntArray
from p2l.skills.reps import SearchDistribution, update

Layout = Literal["grid", "continuous", "board"]
NAMES: dict[Layout, str] = {"grid": "insertion", "continuous": "insertion_continuous", "board": "board"}


@dataclass(frozen=True)
class RepsSettings:
    """Settings of the policy search (thesis, section 4.3.4, uses 10 updates of 40 rollouts)."""

    epsilon: float = 0.5
    updates: int = 10
    samples: int = 40
    minimum_temperature: float = 1e-5
    shrinkage: float = 1.0
    displacement_std: float = 0.0012
    log_stiffness_std: float = 0.05
    variance_floor_share: float = 0.04
    validation_draws: int = 40
    solved_rate: float = 0.95


@dataclass(frozen=True)
class InsertionDomain:
    """Insertion tasks on grid environments, on the lattice (`layout="grid"`) or off it (`"continuous"`), or the board.

    Attributes:
        layout: which task distribution; `"board"` is the peg board.
        physics: the abstract simulation.
        noise_std: standard deviation of the slot estimate, each of x and y, m (thesis: 0.3 cm).
        layout_seed: makes the four grid environments.
        farthest_wall_cm: a grid slot has a wall face at most this far away.
        board_distance_m: range of the distances between hole and wall that the board's predictor is trained on.
        reps: the policy search.
        demonstration: what it starts from.
        nthread: simulator threads.
        encoding: how the predictor sees a pair of tasks: the thesis's `τ_train − τ_test` (section 3.5.1), or the walls
            that the lesson can lean on (`p2l.transfer.encodings`).
    """

    layout: Layout = "grid"
    physics: InsertionPhysics = field(default_factory=InsertionPhysics)
    noise_std: float = 0.003
    layout_seed: int = 0
    farthest_wall_cm: float = 2.0
    board_distance_m: tuple[float, float] = (0.007, 0.025)
    reps: RepsSettings = field(default_factory=RepsSettings)
    demonstration: Demonstration = field(default_factory=Demonstration)
    nthread: int = 2
    encoding: Encoding = "difference"

    @property
    def name(self) -> str:
        """The registered name."""
        return NAMES[self.layout]

    @property
    def feature_names(self) -> tuple[str, ...]:
        """Distances to the next wall in four directions, and the offset of the nearest one."""
        return FEATURE_NAMES

    def sample_tasks(self, rng: np.random.Generator, n: int) -> Tasks:
        """N tasks from which Algorithm 1 collects its data."""
        if self.layout == "board":
            return sample_board_tasks(rng, n, self.board_distance_m)
        sample = sample_grid_tasks if self.layout == "grid" else sample_continuous_tasks
        return sample(rng, n, self.layout_seed, self.farthest_wall_cm)

    def sample_set(self, rng: np.random.Generator, n: int) -> Tasks:
        """One planning problem: grid tasks of the same distribution, or n different holes of the board."""
        if self.layout == "board":
            return board_tasks(rng.permutation(len(board_tasks()))[:n])
        return self.sample_tasks(rng, n)

    def demonstrate(self, tasks: Tasks, rng: np.random.Generator) -> Array:
        """[M, P] the waypoints that a person shows on each task: touch, press, come back, search, push."""
        return self.demonstration.waypoints(tasks, self.physics.hover, rng)

    def learn(self, tasks: Tasks, index: IntArray, rng: np.random.Generator, progress: Progress | None = None) -> Array:
        """Learn one skill per entry of `index` by REPS, all searches together; returns [K, P]."""
        skill_tasks = tasks.take(index)
        searches = self._first_distributions(self.demonstrate(skill_tasks, rng))
        floor = self.reps.variance_floor_share * np.diag(searches[0].covariance)
        best = np.stack([search.mean for search in searches])
        best_rate = self.evaluate_own(best, skill_tasks, self.reps.validation_draws, rng)
        open_rows = np.flatnonzero(best_rate < self.reps.solved_rate)
        for round_index in range(self.reps.updates):
            if not len(open_rows):
                break
            samples = np.stack([searches[k].sample(rng, self.reps.samples) for k in open_rows])
            returns = self._returns(samples, skill_tasks.take(open_rows), rng)
            for row, k in enumerate(open_rows.tolist()):
                searches[k] = self._update(searches[k], samples[row], returns[row], floor)
            means = np.stack([searches[k].mean for k in open_rows])
            rates = self.evaluate_own(means, skill_tasks.take(open_rows), self.reps.validation_draws, rng)
            better = rates >= best_rate[open_rows]
            best[open_rows[better]], best_rate[open_rows[better]] = means[better], rates[better]
            open_rows = np.flatnonzero(best_rate < self.reps.solved_rate)
            if progress is not None:
                progress(round_index + 1, self.reps.updates)
        return best

    def evaluate(
        self,
        skills: Array,
        learnt_on: Tasks,
        tasks: Tasks,
        draws: int,
        rng: np.random.Generator,
        progress: Progress | None = None,
    ) -> BoolArray:
        """Run every skill on every task: success [K, M, R]; a task's draws are shared by all skills."""
        del learnt_on  # a skill's waypoints are relative to the slot estimate, whatever it was learnt on
        count, size = len(skills), len(tasks)
        errors = rng.normal(0.0, self.noise_std, (size, draws, 2))
        k, m, r = (
            axis.ravel() for axis in np.meshgrid(np.arange(count), np.arange(size), np.arange(draws), indexing="ij")
        )
        tips = self._rollouts.tips(skills[k], tasks, m, errors[m, r], progress)
        return np.asarray(is_inserted(tips, self.physics).reshape(count, size, draws))

    def evaluate_own(self, skills: Array, tasks: Tasks, draws: int, rng: np.random.Generator) -> Array:
        """[K] success rate of skill k on task k over `draws` fresh estimate errors."""
        errors = rng.normal(0.0, self.noise_std, (len(skills) * draws, 2))
        rows = np.repeat(np.arange(len(skills)), draws)
        tips = self._rollouts.tips(skills[rows], tasks, rows, errors)
        return np.asarray(is_inserted(tips, self.physics).reshape(len(skills), draws).mean(1))

    def without_walls(self, tasks: Tasks) -> Tasks:
        """The same tasks with every wall removed, for showing that skills use walls."""
        payload = {**tasks.payload, "wall_count": np.zeros(len(tasks), dtype=np.int64)}
        return replace(tasks, payload=payload)

    def view(self, skill: Array, task: Tasks, rng: np.random.Generator, draws: int = 12) -> InsertionView:
        """Paths of the tip in several noise draws."""
        errors = rng.normal(0.0, self.noise_std, (draws, 2))
        paths = self._rollouts.tip_paths(skill, task, errors)
        walls = task.payload["walls"][0, : task.payload["wall_count"][0]]
        success = is_inserted(paths[:, -1], self.physics)
        return InsertionView(task.names[0], walls, self.physics.slot_half_width, paths, success)

    @property
    def _rollouts(self) -> Rollouts:
        return Rollouts(self.physics, self.nthread)

    def _first_distributions(self, means: Array) -> list[SearchDistribution]:
        std = np.tile([self.reps.displacement_std] * 3 + [self.reps.log_stiffness_std], WAYPOINTS)
        return [SearchDistribution(mean, np.diag(std**2)) for mean in means]

    def _update(self, search: SearchDistribution, samples: Array, returns: Array, floor: Array) -> SearchDistribution:
        settings = self.reps
        return update(
            search,
            samples,
            returns,
            epsilon=settings.epsilon,
            minimum_temperature=settings.minimum_temperature,
            shrinkage=settings.shrinkage,
            floor=floor,
        )

    def _returns(self, samples: Array, tasks: Tasks, rng: np.random.Generator) -> Array:
        """[K, N] one for an insertion, plus how deep the tip is and how near it ends to the slot."""
        count, size, parameters = samples.shape
        errors = rng.normal(0.0, self.noise_std, (count * size, 2))
        rows = np.repeat(np.arange(count), size)
        tips = self._rollouts.tips(samples.reshape(-1, parameters), tasks, rows, errors)
        depth = np.clip(-tips[:, 2] / self.physics.slot_depth, 0.0, 1.0)
        miss = np.minimum(np.linalg.norm(tips[:, :2], axis=1) / 0.03, 1.0)
        returns = is_inserted(tips, self.physics) + 0.5 * depth - 0.5 * miss
        return np.asarray(returns.reshape(count, size))
