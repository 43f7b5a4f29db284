"""MetaReSkill on a skill graph of your own, with a training function of your own.

    python -m examples.made_up_graph

Two nominal skills lead to the goal; three failure modes, the first by far the commonest. `train` may do anything that
ends in a success rate: here recoveries saturate, each at its own pace, and what only (0, 2) reaches is worth most.
"""

from __future__ import annotations

import numpy as np

from p2l import History, SkillGraph, Trained, learn, make_chooser

CEILING = np.array([[0.1, 0.5, 0.9], [0.8, 0.6, 0.2], [0.3, 0.3, 0.3]])  # [mode, target]; the last target is the goal
PACE = 0.4


def train(mode: int, target: int, trainings: int) -> Trained:
    """Train the recovery from a failure mode to a target once more; `trainings` counts those before."""
    return Trained(q=float(CEILING[mode, target] * (1.0 - PACE ** (trainings + 1))))


def spend(chooser: str, rounds: int) -> History:
    """All rounds of one chooser."""
    graph = SkillGraph(nominal=np.array([0.9, 0.8]), sizes=np.array([60.0, 25.0, 15.0]), q=np.zeros((3, 3)))
    rule = make_chooser(chooser, {"initial_rounds": 2} if chooser == "metareskill" else {})
    *_, history = learn(graph, rule, train, rounds=rounds, rng=np.random.default_rng(0))
    return history


def main() -> dict[str, float]:
    """Print what each chooser trained, and the value of failures that it reached."""
    values = {}
    for chooser in ("metareskill", "round_robin"):
        history = spend(chooser, rounds=24)
        values[chooser] = history.rounds[-1].value
        print(f"{chooser}: value of failures {values[chooser]:.2f}, rounds by mode and target:")
        print(history.counts)
    return values


if __name__ == "__main__":
    main()
