"""A policy during its training: judged on failures set apart, and kept where it is the best so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from p2l.chaining.agent import agent_of, save_agent
from p2l.chaining.checkpoint import Progress
from p2l.chaining.execute import recover
from p2l.chaining.ground import Ground
from p2l.chaining.learner import Learner
from p2l.chaining.policy import Policy


def judge_and_keep(
    policy: Policy, learner: Learner, apart: Sequence[Ground], progress: Progress, folder: Path
) -> dict[str, float]:
    """The row of an evaluation, which `progress` gets, too; the policy is written to `folder` if none was better.

    Args:
        policy: as it is now.
        learner: its MDP.
        apart: where the evaluation's episodes start; first those of the task itself, which the row's `success` is of.
        progress: of the run, its `control_steps` those that the policy has learnt from.
        folder: of the run.
    """
    agent = agent_of(learner, policy.act)
    recoveries = [recover(one.world, one.nominal, agent, one.failures) for one in apart]
    successes = [each.success for each in recoveries]
    everywhere = float(np.concatenate(successes).mean())
    row: dict[str, float] = {
        "control_steps": progress.control_steps,
        "spared": progress.spared,
        "success": float(successes[0].mean()),
        "episodes": len(successes[0]),
        "evaluation_steps": int(sum(each.steps.sum() for each in recoveries)),
    }
    there: dict[str, float] = {}
    if len(apart) > 1:
        row["success_everywhere"] = everywhere
        pairs = zip(apart[1:], successes[1:], strict=True)
        there = {f"success:{one.name}": float(success.mean()) for one, success in pairs}
        row |= there
    progress.evaluations.append(row)
    if everywhere >= progress.best:  # of equals the later one has learnt from more
        progress.best = everywhere
        facts = {"control_steps": progress.control_steps, "evaluation_success": everywhere, **there, **learner.told}
        save_agent(folder, replace(policy, card=replace(policy.card, told=facts)), learner)
    return row
