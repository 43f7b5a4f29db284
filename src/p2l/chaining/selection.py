"""A policy during its training: judged on failures set apart, and kept where it is the best so far."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from p2l.chaining.agent import agent_of, save_agent
from p2l.chaining.checkpoint import Progress
from p2l.chaining.execute import recover
from p2l.chaining.learner import ChainTask, Learner
from p2l.chaining.policy import Policy
from p2l.contracts.rows import Rows


def judge_and_keep(
    policy: Policy, task: ChainTask, learner: Learner, starts: Rows, progress: Progress, folder: Path
) -> dict[str, float]:
    """The row of an evaluation, which `progress` gets, too; the policy is written to `folder` if none was better.

    Args:
        policy: as it is now.
        task: of the policy.
        learner: its MDP.
        starts: of the evaluation's episodes.
        progress: of the run, its `control_steps` those that the policy has learnt from.
        folder: of the run.
    """
    recoveries = recover(task.world, task.nominal, agent_of(learner, policy.act), starts)
    success = float(recoveries.success.mean())
    row: dict[str, float] = {
        "control_steps": progress.control_steps,
        "spared": progress.spared,
        "success": success,
        "episodes": len(recoveries.success),
        "evaluation_steps": int(recoveries.steps.sum()),
    }
    progress.evaluations.append(row)
    if success >= progress.best:  # of equals the later one has learnt from more
        progress.best = success
        facts = {"control_steps": progress.control_steps, "evaluation_success": success, **learner.told}
        save_agent(folder, replace(policy, card=replace(policy.card, told=facts)), learner)
    return row
