"""The whole report over hand-made stage outputs: everything is there, nothing is fetched, nothing changes by itself."""

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from p2l.artifacts import load_json, save_arrays, save_json, save_table
from p2l.errors import ArtifactError
from p2l.evaluation.page.files import narrow, save_report
from p2l.evaluation.page.page import Films, Link, PageTable, Picture, Reading, Section, render
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.page.views import averages, estimate, plain_setting, setting_label
from p2l.evaluation.report import SECTIONS
from p2l.evaluation.rows import COLUMNS
from p2l.evaluation.team.metrics import summarise
from p2l.evaluation.team.tables import table_3_2
from p2l.evaluation.thesis import load_thesis
from p2l.records import TransferData
from tests.evaluation.team.team_results import FOLDER, METHODS, plans, results, study
from tests.sealing import seal

ROOT = Path(__file__).resolve().parents[3]
RESULTS = ROOT / "results/thesis/tables"

REGIMES = {
    "high_teaching": {"c_rob": 10, "c_hum": 100, "c_fail": 100, "c_demo": 200, "levels": [0, 2]},
    "low_teaching": {"c_rob": 10, "c_hum": 100, "c_fail": 100, "c_demo": 100, "levels": [0, 2]},
}
BOARD = {"board": {"c_rob": 10, "c_hum": 100, "c_fail": 100, "c_demo": 300, "levels": [0]}}
TABLES = {
    "objective",
    *("walls", "transfer_model", "figure_3_7", "table_3_1", "table_3_2", "figure_3_10", "figure_3_10_insertion"),
    *("order_any", "prediction_price", "nominal", "failure_modes"),
    *("tomorrow_3", "replanning_3", "preferences_3"),
}
FIGURES = {"overview", "environments", "figure_3_7", "table_3_1", "figure_3_9", "figure_3_10", "figure_3_10_insertion"}
DOMAINS = ("insertion", "board", "lego")
WORLDS = ("door", "pick_place")


class HalfModel:
    """Predicts 0.5 for all pairs."""

    def predict(self, train, test):
        return np.full((len(train), len(test)), 0.5)


def write_domain(data, domain):
    """What the four stages leave of a domain."""
    board = domain == "board"
    frame = results({method: [400.0, 410.0] for method in METHODS}, "board") if board else study()
    plan = plans("board", sets=2) if board else plans("high_teaching")
    folder = data / "evaluate_team" / domain
    save_table(folder / "results.parquet", frame, schema="team_results", version=1)
    save_table(folder / "summary.parquet", summarise(frame), schema="team_summary", version=1)
    save_table(data / "plan" / domain / "plans.parquet", plan, schema="plans", version=1)
    thetas = {"board": 0.0} if board else {"high_teaching": 0.2, "low_teaching": 0.4}
    save_json(data / "plan" / domain / "summary.json", {"thetas": thetas}, schema="plan_summary", version=1)
    rate = {"mean": 1.0, "low": 0.9, "high": 1.0, "trials": 30}
    collected = {"own_task_success": rate}
    if domain != "lego":
        collected["own_task_success_without_walls"] = {**rate, "mean": 0.0, "low": 0.0, "high": 0.1}
    save_json(data / "collect" / domain / "summary.json", collected, schema="collect_summary", version=1)
    transfer = TransferData(
        ("a/0", "b/1"),
        np.zeros((2, 1)),
        ("width",),
        np.array([0, 1]),
        np.array([0]),
        np.ones((1, 2)),
        1,
        np.ones((1, 1)),
    )
    path = data / "collect" / domain / "transfer_data.npz"
    save_arrays(path, transfer.arrays(), schema="transfer_data", version=1)
    (data / "collect" / domain / "strategy.png").write_bytes(b"a picture")
    scores = [
        {"method": method, "pairs": "new_test", "metric": metric, "mean": 0.2, "low": 0.1, "high": 0.3, "n": 9}
        for method in ("model", "uncorrected", "nearest_neighbour", "constant")
        for metric in ("auc", "brier", "log_loss", "ece")
    ]
    path = data / "fit_transfer" / domain / "metrics.json"
    save_json(path, {"scores": scores}, schema="fit_transfer_metrics", version=1)
    (path.parent / "calibration.png").write_bytes(b"a picture")
    planned = [{**score, "pairs": "planned"} for score in scores if score["method"] == "model"]
    path = data / "evaluate_team" / domain / "predictions.json"
    save_json(path, {"scores": planned}, schema="planned_predictions", version=1)
    config = data / "config" / domain
    config.mkdir(parents=True)
    (config / "collect.yaml").write_text(yaml.safe_dump({"domain": {"name": domain, "params": {}}}))
    orders = [["0", "2", "12"], ["0", "2", "12"]] if board else []
    chosen = {"regimes": BOARD if board else REGIMES, "draws": 4, "orders": orders}
    (config / "evaluate_team.yaml").write_text(yaml.safe_dump({"study": chosen}))


def write_world(data, world, successes, filmed):
    """What discover and cluster leave of a world: half the failures are missed handles."""
    split = {
        "executions": 60,
        "diverged": 1,
        "success": {"mean": successes / 50, "low": 0.1, "high": 0.9, "trials": 50},
        "failures": 20,
        "first_kind": {"missed_handle": 10, "stranded": 10},
    }
    found = {"strategy": "pessimistic" if world == "door" else "first_flag", "train": split, "held_out": split}
    save_json(data / "discover" / world / "summary.json", found, schema="discover_summary", version=1)
    mode = {"size": 10, "weight": 0.5, "held_out": 3, "typical": 0, "probability": 0.9, "kind:stranded": 1.0}
    mode |= {"kind:missed_handle": 0.0, "option:pull": 0.7, "option:reach": 0.3, "mean:gap_m": 0.01}
    modes = [{"mode": number, **mode} for number in range(2)]
    grouped = {"strategy": found["strategy"], "executions": 60, "failures": 20, "held_out": 6, "modes": modes}
    folder = data / "cluster" / world
    save_json(folder / "summary.json", grouped, schema="cluster_summary", version=1)
    (folder / "modes.png").write_bytes(b"a picture")
    shown = [{"file": f"mode_{number}.mp4", "option": "pull", "kind": "stranded", "time_s": 3.5} for number in range(2)]
    index = {"videos": shown, "skipped": None} if filmed else {"videos": [], "skipped": "no videos: install libegl1"}
    save_json(folder / "videos" / "videos.json", index, schema="videos", version=1)
    for one in index["videos"]:
        (folder / "videos" / one["file"]).write_bytes(b"a film")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stages") / "data"
    for domain in DOMAINS:
        write_domain(folder, domain)
    write_world(folder, "door", successes=34, filmed=True)
    write_world(folder, "pick_place", successes=10, filmed=False)
    seal(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Sources, "model", lambda self, domain: HalfModel())
        yield folder


@pytest.fixture(scope="module")
def report(data, tmp_path_factory):
    """The folder of a report over all domains."""
    out = tmp_path_factory.mktemp("report")
    make(data, out)
    return out


def make(data, out, domains=DOMAINS, worlds=WORLDS):
    sections = [section(Sources(data, FOLDER, domains, worlds, results=RESULTS)) for section in SECTIONS]
    save_report(out, "Report", ["About."], sections)
    return (out / "index.html").read_text()


class Resources(HTMLParser):
    """Collects what a page would fetch, and checks that what it opens it closes."""

    def __init__(self):
        super().__init__()
        self.found, self.open = [], []

    def handle_starttag(self, tag, attrs):
        self.found += [value for name, value in attrs if name in ("src", "href", "srcset", "data")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_holds_every_table_and_figure_and_fetches_nothing(report):
    page = (report / "index.html").read_text()
    assert {path.stem for path in (report / "tables").iterdir()} == TABLES
    figures = {path.stem for path in (report / "figures").iterdir()}
    of_domains = {f"{kind}_{d}" for kind in ("strategy", "calibration", "transfer") for d in DOMAINS}
    assert figures == FIGURES | of_domains | {f"modes_{world}" for world in WORLDS}
    assert all(f"tables/{name}.csv" in page for name in TABLES)
    assert all(f'alt="{name}"' in page for name in figures)
    parser = Resources()
    parser.feed(page)
    assert not parser.open
    assert all(re.match(r"#|\.\./\.\./docs/|data:(image/png|video/mp4);base64,", link) for link in parser.found)
    assert "url(" not in page
    assert "<script" not in page


def test_nominal_skills_stand_beside_the_thesis(report):
    page = (report / "index.html").read_text()
    table = pd.read_csv(report / "tables" / "nominal.csv").set_index(["setting", "metric"])
    assert table.loc[("world=door", "success"), "mean"] == 0.68
    assert table.loc[("world=door", "success"), "thesis"] == 0.71
    assert table.loc[("world=pick_place", "success"), "thesis"] == 0.7
    assert table.loc[("world=door", "failures_per_execution"), "mean"] == 0.4
    assert table.loc[("world=door", "first_failure/missed_handle"), "mean"] == 0.5
    assert re.search(r"door: 68.0 % \[[\d., ]+\]\. <span class=\"mark\">✓", page)
    assert re.search(r"pick_place: 20.0 % \[[\d., ]+\]\. <span class=\"mark\">✗", page)
    modes = pd.read_csv(report / "tables" / "failure_modes.csv").set_index(["setting", "metric"])
    assert modes.loc[("world=door", "modes"), "mean"] == 2
    assert modes.loc[("world=door;mode=1", "option/pull"), "mean"] == 0.7
    assert page.count("<video") == 2
    assert "pick_place: no videos: install libegl1" in page


def test_without_worlds_their_sections_say_so(data, tmp_path):
    page = make(data, tmp_path, worlds=())
    assert page.count("Left out: conf/pipeline.yaml runs no worlds") == 2


def test_a_missing_film_names_the_stage_to_run(data, tmp_path):
    broken = tmp_path / "data"
    shutil.copytree(data, broken)
    (broken / "cluster" / "door" / "videos" / "mode_1.mp4").unlink()
    with pytest.raises(ArtifactError, match=r"mode_1\.mp4.*dvc repro cluster"):
        Sources(broken, FOLDER, DOMAINS, WORLDS).videos("door")


def test_csv_files_have_the_promised_columns(report):
    for path in (report / "tables").iterdir():
        table = pd.read_csv(path)
        assert tuple(table.columns) == COLUMNS or path.stem == "preferences_3"
        assert len(table) > 0


def test_two_reports_have_the_same_bytes(data, report, tmp_path):
    make(data, tmp_path)
    first, second = (
        {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.*")} for folder in (report, tmp_path)
    )
    assert first == second


def test_headline_numbers_are_those_of_the_tables(report):
    numbers = load_json(report / "metrics.json", schema="report_metrics", version=1)
    assert numbers["table_3_2/adl"] == 900.0
    assert (numbers["figure_3_7/levels_adl_cheapest"], numbers["figure_3_7/levels_adl_tied"]) == (1.0, 1.0)
    assert numbers["walls/board/removed"] == 0.0
    assert all(re.fullmatch(r"[\w./ -]+", name) for name in numbers)


@pytest.mark.parametrize("kept", [("lego",), ("insertion", "board")])
def test_what_needs_a_missing_domain_is_left_out_and_says_so(data, tmp_path, kept):
    page = make(data, tmp_path / "out", kept)
    written = {path.stem for path in (tmp_path / "out" / "tables").iterdir()}
    needs = {"table_3_1": "board", "table_3_2": "lego", "figure_3_7": "insertion", "figure_3_10": "lego"}
    assert {name for name, domain in needs.items() if domain in kept} == written & set(needs)
    assert "Left out: it needs" in page
    assert f"conf/pipeline.yaml runs {', '.join(kept)}" in page


def test_a_damaged_input_is_refused(data, tmp_path):
    broken = tmp_path / "data"
    shutil.copytree(data, broken)
    (broken / "evaluate_team" / "lego" / "results.parquet").write_bytes(b"nothing")
    with pytest.raises(ArtifactError, match=r"results\.parquet"):
        Sources(broken, FOLDER, DOMAINS).team("lego")
    config = broken / "config" / "lego" / "collect.yaml"
    config.write_text("{")
    with pytest.raises(ArtifactError, match=r"collect\.yaml: is not as its stage wrote it.*dvc repro config"):
        Sources(broken, FOLDER, DOMAINS).world("lego")
    seal(broken)
    with pytest.raises(ArtifactError, match=r"(?s)collect\.yaml: no readable configuration.*dvc repro config"):
        Sources(broken, FOLDER, DOMAINS).world("lego")


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("fit_transfer/lego/calibration.png", lambda sources: sources.image("fit_transfer", "lego", "calibration.png")),
        ("cluster/door/videos/mode_0.mp4", lambda sources: sources.videos("door")),
        ("config/lego/evaluate_team.yaml", lambda sources: sources.team("lego")),
    ],
)
def test_half_a_file_is_refused(data, tmp_path, name, read):
    """Half a picture, film or configuration went into the page unnoticed, or ended in a KeyError."""
    shutil.copytree(data, tmp_path / "data")
    sources, path = Sources(tmp_path / "data", FOLDER, DOMAINS, WORLDS), tmp_path / "data" / name
    assert read(sources)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ArtifactError, match=rf"{path.name}: is not as its stage wrote it"):
        read(sources)


def test_a_missing_picture_names_the_stage_to_run(data):
    with pytest.raises(ArtifactError, match="dvc repro fit_transfer"):
        Sources(data, FOLDER, DOMAINS).image("fit_transfer", "lego", "absent.png")


def test_two_tables_of_one_name_are_refused(tmp_path):
    sheet = PageTable("same", pd.DataFrame(), [], [], "")
    with pytest.raises(ArtifactError, match="same made by two sections"):
        save_report(tmp_path, "t", [], [Section("a", [sheet]), Section("b", [sheet])])
    assert list(tmp_path.iterdir()) == []


def test_text_is_escaped_and_verdicts_are_shown():
    sheet = PageTable("t", pd.DataFrame(), ["<x-head>"], [["<x-cell>"]], "<x-caption>")
    parts = ["<x-words>", Reading("<x-claim>", "<x-ours>", "partly"), sheet, Picture("p", b"png", "<x-figure>")]
    parts += [Films([("<x-film>", b"mp4", "<x-scene>")]), Link("<x-file>", "<x-heading>")]
    page = render("<x-title>", ["<x-lead>"], [Section("<x-section>", parts, ["<x-command>"])])
    words = ("head", "cell", "caption", "words", "claim", "ours", "figure", "title", "lead", "section", "command")
    words += ("film", "scene", "file", "heading")
    assert all(f"&lt;x-{word}&gt;" in page for word in words)
    assert "<x-" not in page
    assert "≈ in part" in page


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ((1.25, 1.0, 1.5, 1), "1.2 [1.0, 1.5]"),
        ((3.0,), "3"),
        ((float("nan"),), "–"),
        ((900.4, 800.6, 1000.2), "900 [801, 1000]"),
    ],
)
def test_estimates_are_written_with_their_limits(numbers, text):
    assert estimate(*numbers) == text


def test_settings_are_spoken_and_become_paths():
    setting = "domain=lego;regime=high_teaching;pretrained=4"
    assert setting_label(setting) == "lego, high cost of teaching, 4 pre-trained"
    assert setting_label("domain=board;regime=board") == "board"
    assert plain_setting(setting) == "lego/high_teaching/4"


def test_table_3_2_shows_the_thesis_below_ours():
    frame = results({"adl": [800.0, 1000.0], "cba_best": [900.0, 900.0]})
    table = table_3_2(frame, load_thesis(FOLDER, 3))
    ours, thesis = averages(table, "adl", ["executed_cost", "demos"])
    assert ours[:1] == ["ADL"]
    assert ours[1].startswith("900 ± 141 [")
    assert thesis == ["– thesis", "856 ± 120.9", "1.2 ± 0.4"]
    assert len(averages(table, "cba_best", ["executed_cost"])) == 1


@pytest.mark.parametrize("name", ["../../../secret.txt", "/etc/passwd", "link.mp4"])
def test_a_film_outside_its_folder_is_not_embedded(tmp_path, name):
    """The page embedded whatever file `videos.json` named."""
    folder = tmp_path / "data/cluster/door/videos"
    folder.mkdir(parents=True)
    (tmp_path / "secret.txt").write_text("secret")
    (folder / "link.mp4").symlink_to(tmp_path / "secret.txt")
    index = {"videos": [{"file": name}], "skipped": None}
    save_json(folder / "videos.json", index, schema="videos", version=1)
    with pytest.raises(ArtifactError, match="lies outside its folder"):
        Sources(tmp_path / "data", FOLDER, DOMAINS, WORLDS).videos("door")


def test_the_few_numbers_of_dvc_metrics_have_short_names_and_fit_a_terminal():
    """`dvc metrics show` was 11,610 columns wide."""
    numbers = {
        "table_3_2/adl": 866.55,
        "table_3_2/adl_any": 769.8,
        "figure_4_7/door/over_round_robin/final_gain": 0.25038,
        "table_4_1/door/recoveries/success": 0.986,
        "table_4_1/door/recoveries/over_open_loop/gain": 0.25,
        "table_5_1/pick_place/rc/success": 0.921,
        "table_5_1/pick_place/rc/recovery": 0.7,
    }
    few = {"lego_cost": 866.55, "door_value_gain": 0.2504, "door_recoveries": 0.986, "pick_place_rc": 0.921}
    assert narrow(numbers) == few
    metrics = [stage.get("metrics", []) for stage in yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"].values()]
    assert [name for names in metrics for name in names] == ["data/report/headline.json"]


def test_headlines_are_on_disk(report):
    assert json.loads((report / "headline.json").read_text())["lego_cost"] == 900.0
