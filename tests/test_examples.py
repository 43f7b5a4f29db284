"""Every example does what it says."""

from pathlib import Path

import numpy as np
import pytest

from examples import branching_graph, made_up_graph, plan_a_day, watch_failure
from p2l import Decision
from p2l.evaluation.video.player import NoGLError, backend

ROOT = Path(__file__).resolve().parents[1]


def test_a_day_is_planned_with_one_lesson(capsys):
    day = plan_a_day.main()
    assert day.status == "optimal"
    assert day.decision.tolist() == [Decision.LEARN, Decision.ACT, Decision.ACT, Decision.ACT]
    assert "Checked without the solver" in capsys.readouterr().out


def test_a_made_up_graph_is_trained_where_it_pays(capsys):
    values = made_up_graph.main()
    assert values["metareskill"] > values["round_robin"]
    assert capsys.readouterr().out.count("rounds by mode and target") == 2


def test_the_way_through_a_branching_graph_changes_with_what_was_trained(capsys):
    history = branching_graph.main()
    assert "before: carry; after: throw" in capsys.readouterr().out
    assert history.counts[branching_graph.DROPPED, branching_graph.START] > 2


def test_a_recorded_failure_is_found_again_and_filmed(tmp_path):
    failures = watch_failure.recorded(tmp_path / "failures.npz")
    assert set(failures.kind_names()) == {"missed"}
    assert failures.origin.world == watch_failure.WORLD
    try:
        backend()
    except NoGLError as error:
        pytest.skip(str(error))
    film = watch_failure.main(tmp_path)
    assert film.read_bytes()[4:8] == b"ftyp"


def test_examples_are_short():
    files = {file.relative_to(ROOT / "examples").as_posix(): file for file in (ROOT / "examples").rglob("*.py")}
    lengths = {name: len(file.read_text().splitlines()) for name, file in files.items()}
    environments = {
        name
        for name in lengths
        if name.split("/")[0] in ("deploy.py", "fetch", "metaworld_sawyer", "robosuite_stack", "shop")
    }
    assert max(lengths[name] for name in environments) < 120, lengths
    assert max(lines for name, lines in lengths.items() if name not in environments) < 60, lengths


def test_training_of_the_made_up_graph_saturates():
    rates = [made_up_graph.train(0, 2, trainings).q for trainings in range(20)]
    assert np.diff(rates).min() > 0.0
    assert rates[-1] == pytest.approx(made_up_graph.CEILING[0, 2], abs=1e-6)
