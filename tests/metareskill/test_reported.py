"""Values on a third split: what choosers saw where the split is theirs, measured once, and never of skills not kept."""

from dataclasses import replace

import numpy as np
import pytest

from p2l.errors import ArtifactError, ConfigError
from p2l.metareskill.chooser_run import train_recoveries
from p2l.metareskill.choosers.table import make_chooser
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.ledger import Ledger
from p2l.metareskill.members import Members
from p2l.metareskill.query import QueryOptions
from p2l.metareskill.reported import ReportedSplit, keep_history, reported_split, reported_values
from p2l.metareskill.setting import Setting
from p2l.metareskill.start import Start
from p2l.metareskill.trainer import Trainer
from p2l.metareskill.value_iteration import value_of_failures
from tests.failures.pushing import found
from tests.metareskill import pushing_back as pb

OPTIONS = QueryOptions(updates=2, rollouts=8, solved=0.3, timing=pb.TIMING)
SETTINGS = {"rounds": 9, "episodes": 1}


def far(task, past_m):
    """Failures of mode 0 in a row, beside the block."""
    rows = pb.standing(task.world, np.asarray(past_m), 0.08)
    return Members(rows, np.zeros(len(past_m), dtype=np.int64))


@pytest.fixture(scope="module")
def trained():
    task = pb.setting(estimator="exact")[1]
    given = far(task, np.linspace(0.10, 0.16, 6)), far(task, [0.11, 0.13, 0.15])
    trainer = Trainer(task, *given, OPTIONS, 0, Ledger(""), Start.nothing(2, 3))
    graph = SkillGraph(np.array([0.9, 0.9]), np.array([6.0]), np.zeros((1, 3)))
    history = train_recoveries(trainer, graph, make_chooser("round_robin"), **SETTINGS)
    assert history.best.max() > 0.0, "something was learnt"
    return task, trainer, graph, history


def test_on_the_choosers_own_split_the_values_are_those_that_it_saw(trained):
    _, trainer, graph, history = trained
    assert reported_values(trainer, graph, history, trainer.held_out) == [-10.0, *history.values.tolist()]


def test_on_another_split_the_kept_skills_are_measured_again(trained):
    task, trainer, graph, history = trained
    lucky = {key: replace(entry, q=1.0) for key, entry in trainer.ledger.entries.items()}  # measured on one failure
    trainer = replace(trainer, ledger=Ledger("", entries=lucky))
    history = train_recoveries(trainer, graph, make_chooser("round_robin"), **SETTINGS)
    beyond = far(task, [0.12, 0.14, 0.30, 0.34])
    values = reported_values(trainer, graph, history, beyond)
    q = graph.q.copy()
    for target in range(3):
        if (skill := trainer.skill(0, target, int(history.counts[0, target]))) is not None:
            q[0, target] = replace(trainer, held_out=beyond).measure(skill, 0, target)[0]
    assert values[-1] == float(value_of_failures(graph, q))
    assert values[-1] < history.values[-1]
    assert len(values) == len(history) + 1
    assert values[0] == -10.0, "nothing works before it is trained"


def test_values_are_measured_once_and_another_split_is_another_record(trained, tmp_path, monkeypatch):
    task, trainer, graph, history = trained
    classifier = pb.modes(task.world)
    setting = Setting(
        task, classifier, trainer.failures, trainer.held_out, graph, OPTIONS, trials=2, start=Start.nothing(2, 3)
    )
    split = ReportedSplit(setting, found()[2].failures, 7)
    vars(split)["failures"] = far(task, [0.12, 0.14])  # as if these were found

    def kept(split):
        return keep_history(tmp_path, "push", trainer, "round_robin", graph, history, split, SETTINGS)

    first = kept(split)
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "push-round_robin-s0-b0.json", "push-round_robin_reported-s0-b0.json"
    ]  # fmt: skip
    with monkeypatch.context() as still:
        still.setattr(Trainer, "measure", lambda *_: 1 / 0)
        assert kept(split).tolist() == first.tolist()
        assert kept(None).tolist() == [-10.0, *history.values.tolist()]
    other = replace(split, executions=8)
    vars(other)["failures"] = split.failures
    assert len(kept(other)) == len(first)
    assert len(list(tmp_path.iterdir())) == 3


def test_a_mode_without_a_reported_failure_is_refused_before_any_training(tmp_path):
    world, task, _ = pb.setting(estimator="exact")
    classifier = pb.modes(world)
    graph = SkillGraph(np.array([0.9, 0.9]), np.array([3.0, 1.0]), np.zeros((2, 3)))
    some = Members(pb.standing(world, [0.1, 0.1], [0.08, -0.08]), np.array([0, 1]))
    setting = Setting(task, classifier, some, some, graph, OPTIONS, trials=2, start=Start.nothing(2, 3))
    failures = found()[2].failures
    assert reported_split(setting, failures, 0, tmp_path, "push") is None
    with pytest.raises((ConfigError, ArtifactError), match=r"reported=2: none of these executions|no failure"):
        reported_split(setting, failures, 2, tmp_path, "push")
    (tmp_path / "push-ucb1_reported-s0-b0.json").write_text("{}")
    reported_split(setting, failures, 2, tmp_path, "push")  # where values are recorded nothing is simulated
