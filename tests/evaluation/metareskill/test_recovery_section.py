"""Preconditions and rounds of training in the report, over hand-made results of two skills and two modes."""

import math

import pandas as pd
import pytest

from p2l.artifacts import save_json
from p2l.evaluation.metareskill import section as recoveries
from p2l.evaluation.page.page import Films, Reading
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.rows import COLUMNS
from tests.evaluation.team.team_results import FOLDER
from tests.sealing import seal

SCORES = ("accuracy", "precision", "recall", "solved_where_it_holds")
UNKNOWN = math.nan
# round, mode, target, reason, q_before, q_upper, predicted, q, solved, value
METARESKILL = [
    (1, 0, 0, "initial round", 0.0, UNKNOWN, UNKNOWN, 0.5, True, -7.0),
    (2, 1, 0, "initial round", 0.0, UNKNOWN, UNKNOWN, 0.0, False, -7.0),
    (3, 0, 0, "highest predicted value", 0.5, 0.75, -6.0, 0.75, True, -6.5),
    (4, 0, 0, "highest predicted value", 0.75, 1.0, -6.0, 0.5, False, -6.5),
]
ROUND_ROBIN = METARESKILL[:2] + [
    (3, 0, 1, "its turn", 0.0, UNKNOWN, UNKNOWN, 0.0, False, -7.0),
    (4, 1, 1, "its turn", 0.0, UNKNOWN, UNKNOWN, 0.0, False, -7.0),
]
COUNTS = {"metareskill": (3, 0, 1, 0), "round_robin": (1, 1, 1, 1)}


def write(folder, values=(-10.0, -7.0, -7.0, -7.0, -7.0)):
    """What fit_preconditions and learn_recoveries leave."""
    fitted, learnt = folder / "fit_preconditions" / "door", folder / "learn_recoveries" / "door"
    (learnt / "graphs").mkdir(parents=True)
    fitted.mkdir(parents=True)
    rows = [(skill, metric, 0.9, 0.8, 0.95, 20) for skill in ("reach", "pull_handle") for metric in SCORES]
    scores = pd.DataFrame(rows, columns=["skill", "metric", "value", "low", "high", "n"])
    scores.to_csv(fitted / "scores.csv", index=False)
    grown = [("reach", 25, 0, 0.7), ("reach", 60, 0, 0.9), ("pull_handle", 60, 0, 0.9)]
    pd.DataFrame(grown, columns=["skill", "samples", "draw", "accuracy"]).to_csv(fitted / "accuracy.csv", index=False)
    columns = ["round", "mode", "target", "reason", "q_before", "q_upper", "predicted", "q", "solved", "value"]
    frames = [
        pd.DataFrame(rows, columns=columns).assign(seed=0, chooser=chooser)
        for chooser, rows in (("metareskill", METARESKILL), ("round_robin", ROUND_ROBIN))
    ]
    rounds = pd.concat(frames).assign(target_name=lambda table: table["target"].map({0: "reach", 1: "goal"}))
    rounds.to_csv(learnt / "rounds.csv", index=False)
    curves = {"metareskill": (-10.0, -7.0, -7.0, -6.5, -6.5), "round_robin": values}
    told = [(0, chooser, count, value) for chooser, curve in curves.items() for count, value in enumerate(curve)]
    pd.DataFrame(told, columns=["seed", "chooser", "queries", "value"]).to_csv(learnt / "figure_4_7.csv", index=False)
    given = [
        (0, chooser, mode, target, COUNTS[chooser][2 * mode + number], 0.5)
        for chooser in COUNTS
        for mode in (0, 1)
        for number, target in enumerate(("reach", "goal"))
    ]
    names = ["seed", "chooser", "mode", "target", "trained", "q"]
    pd.DataFrame(given, columns=names).to_csv(learnt / "figure_4_6.csv", index=False)
    shown = [
        {"file": "before.mp4", "mode": 0, "moment": "before", "told": "slip in pull_handle"},
        {"file": "after.mp4", "mode": 0, "moment": "after", "told": "recovery_0_reach, reach", "solved": True},
    ]
    save_json(learnt / "videos" / "videos.json", {"videos": shown, "skipped": None}, schema="videos", version=1)
    for one in shown:
        (learnt / "videos" / one["file"]).write_bytes(b"a film")
    for picture in (fitted / "preconditions.png", learnt / "graphs" / "s0.png"):
        picture.write_bytes(b"a picture")


def sections(folder):
    sources = Sources(seal(folder), FOLDER, (), ("door",), ("door",))
    return recoveries.preconditions(sources), recoveries.learning(sources)


def readings(section):
    return [part for part in section.parts if isinstance(part, Reading)]


def test_preconditions_stand_with_their_intervals_and_all_their_samples(tmp_path):
    write(tmp_path)
    section, _ = sections(tmp_path)
    [reading], [sheet] = readings(section), section.sheets
    assert reading.ours.startswith("160 samples; ")  # 60 for each skill to train, 20 held out
    assert sheet.rows[1] == ["pull handle", *["0.90 [0.80, 0.95]"] * 4]
    assert section.metrics["preconditions/door/reach/accuracy"] == 0.9
    assert section.commands[-1].startswith("python -m stages.fit_preconditions")


def test_rounds_tell_what_was_chosen_why_and_what_came_of_it(tmp_path):
    write(tmp_path)
    _, section = sections(tmp_path)
    [sheet] = section.sheets
    why = "highest predicted value"
    assert sheet.rows[0] == ["3", "0 → reach", why, "0.50", "0.75", "0.75", "-6.00", "-6.50", "yes"]
    assert len(sheet.rows) == 2
    assert tuple(sheet.long.columns) == COLUMNS
    assert len(sheet.long) == 20  # five numbers of four rounds, of the chooser whose skills are kept
    predicted = readings(section)[-1]
    # promised: -6 after -7, and -6 after -6.5; brought: 0.5 and 0
    assert "promise +0.750 each on average and bring +0.250; 50% of their queries are solved" in predicted.ours
    assert section.metrics["recoveries/door/value/metareskill"] == -6.5
    assert section.metrics["recoveries/door/queries_solved"] == 0.5


def test_each_mode_is_shown_before_and_after(tmp_path):
    write(tmp_path)
    [films] = [part for part in sections(tmp_path)[1].parts if isinstance(part, Films)]
    assert [caption for _, _, caption in films.films] == [
        "Mode 0, before learning: slip in pull handle",
        "Mode 0, after learning: recovery 0 reach, reach; solved",
    ]


@pytest.mark.parametrize(
    ("values", "agrees", "words"),
    [
        ((-10.0, -7.0, -7.0, -7.0, -7.0), "yes", "after 25% of the budget"),
        ((-10.0, -9.0, -8.0, -7.0, -7.0), "partly", "after 75% of the budget"),
        ((-10.0, -9.0, -8.0, -7.0, -6.0), "no", "after 100% of the budget"),
        ((-10.0, -10.0, -10.0, -10.0, -10.0), "no", "improves nothing"),
    ],
)
def test_whether_round_robin_saturates(tmp_path, values, agrees, words):
    write(tmp_path, values)
    found = readings(sections(tmp_path)[1])[0]
    assert (found.agrees, words in found.ours) == (agrees, True)


def test_without_recovery_worlds_the_sections_say_so(tmp_path):
    sources = Sources(tmp_path, FOLDER, (), ("shelf",))
    for make in (recoveries.preconditions, recoveries.learning):
        assert make(sources).parts == ["Left out: conf/pipeline.yaml names no recovery_worlds. Add them there."]
