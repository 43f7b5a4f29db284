"""Tables of tomorrow: what they say, one message for what is wrong, and samples of forecasts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from two_stage_instances import large_program

from p2l.errors import ConfigError, InputError, ShapeError
from p2l.team.sheets import read_sheet
from p2l.team.tomorrow import Forecast, gap_interval, plan_two_stage, replicate, sample_counts, with_counts
from p2l.team.tomorrow.reading import Future, read_two_stage
from p2l.team.tomorrow.sampling import estimate, fresh_samples, subsamples
from p2l.team.tomorrow.tables import read_forecast, read_scenarios

TYPES = ("lid", "gear")
ORDERS = "task,c_rob,c_hum,c_fail,c_demo\ngear,10,100,100,120\nlid,10,100,100,200\n"
TRANSFER = "taught,tested,p\ngear,lid,0.9\ngear,gear,0.9\nlid,gear,0.5\nlid,lid,0.8\n"


@pytest.fixture
def sheet(tmp_path):
    def write(text, name="table.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_scenarios_as_an_excel_with_decimal_commas_has_them(sheet):
    text = "Scenario;Task;Count;Probability;Note\nbusy;lid;3;0,25;x\nbusy;gear;1;;\nquiet;lid;0;0,75;\nnever;lid;9;0;\n"
    found = read_scenarios(read_sheet(sheet(text)), TYPES)
    assert found.names == ("busy", "quiet")
    assert found.counts.tolist() == [[3, 1], [0, 0]]
    assert found.probability.tolist() == [0.25, 0.75]
    assert "'Note'" in found.remarks[0]
    assert "probability 0 are left out (1 of 3)" in found.remarks[1]
    equal = read_scenarios(read_sheet(sheet("scenario,task,count\n1,lid,3\n2,gear,1\n")), TYPES)
    assert equal.probability.tolist() == [0.5, 0.5]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("scenario,task\n1,lid\n", "column 'count': column is missing"),
        ("scenario,task,count\n", "header but no scenarios"),
        ("scenario,task,count\n1,lidd,2\n", "row 2, column 'task': 'lidd' is no task that may come; is it 'lid'?"),
        ("scenario,task,count\n1,lid,2\n1,lid,3\n", "row 3, column 'task': 'lid' is in row 2 of this scenario"),
        ("scenario,task,count\n1,lid,-2\n", "row 2, column 'count': '-2' is not allowed; give a whole number"),
        ("scenario,task,count\n1,lid,1.5\n", "row 2, column 'count': '1.5' is not allowed"),
        ("scenario,task,count\n,lid,1\n", "row 2, column 'scenario': a scenario has no name"),
        (
            "scenario,task,count,probability\n1,lid,1,0.5\n2,lid,2,0.4\n",
            "row 3, column 'probability': the probabilities of the 2 scenarios sum to 0.9; expected 1",
        ),
        (
            "scenario,task,count,probability\n1,lid,1,0.5\n1,gear,1,0.4\n2,lid,2,0.5\n",
            "row 3, column 'probability': '0.4' for scenario '1', which has 0.5",
        ),
        (
            "scenario,task,count,probability\n1,lid,1,1\n2,lid,2,\n",
            "row 3, column 'probability': scenario '2' has no probability",
        ),
        ("scenario,task,count,probability\n1,lid,1,1.5\n", "row 2, column 'probability': '1.5' is not allowed"),
    ],
)
def test_a_wrong_table_of_scenarios_is_one_message(sheet, text, words):
    with pytest.raises(InputError) as refused:
        read_scenarios(read_sheet(sheet(text)), TYPES)
    assert words in str(refused.value)
    assert "table.csv" in str(refused.value)


def test_a_forecast_of_all_kinds(sheet):
    text = "task,mean,distribution,p0,p1,p2\nlid,,,50%,25%,25%\ngear,3,Fixed,,,\n"
    found = read_forecast(read_sheet(sheet(text)), TYPES)
    assert found.mean.tolist() == [0.75, 3.0]
    assert found.distribution == ("given", "fixed")
    counts = sample_counts(found, 400, np.random.default_rng(0))
    assert set(counts[:, 0]) == {0.0, 1.0, 2.0}
    assert set(counts[:, 1]) == {3.0}
    some = read_forecast(read_sheet(sheet("task,mean\nlid,0.5\n")), TYPES)
    assert (some.mean.tolist(), some.distribution) == ([0.5, 0.0], ("poisson", "poisson"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("task,mean\nlid,\n", "row 2, column 'mean': task 'lid' has no expected number"),
        ("task,mean\nlid,-1\n", "row 2, column 'mean': '-1' is not allowed"),
        ("task,mean\nlid,1e9\n", "row 2, column 'mean': '1e9' is not allowed; give a number from 0 to 1000"),
        ("task,mean\nlid,1\nlid,2\n", "row 3, column 'task': task 'lid' appears twice"),
        ("task,mean\ncog,1\n", "row 2, column 'task': 'cog' is no task that may come"),
        ("task,mean,distribution\nlid,1,poison\n", "row 2, column 'distribution': 'poison' is no distribution; is it"),
        ("task,mean,distribution\nlid,1.5,fixed\n", "row 2, column 'mean': 1.5 copies for sure cannot be"),
        ("task,p0,p1\nlid,0.5,0.4\n", "row 2, column 'p1': its probabilities sum to 0.9; expected 1"),
        ("task,mean,p0,p1\nlid,1,0.5,0.5\n", "row 2, column 'mean': '1' and probabilities of numbers are given"),
        ("task,p0,p2\nlid,0.5,0.5\n", "column 'p0': probabilities of [0, 2] copies given"),
    ],
)
def test_a_wrong_forecast_is_one_message(sheet, text, words):
    with pytest.raises(InputError) as refused:
        read_forecast(read_sheet(sheet(text)), TYPES)
    assert words in str(refused.value)


def read(sheet, future, **changes):
    orders, transfer = sheet(ORDERS, "orders.csv"), sheet(changes.pop("transfer", TRANSFER), "transfer.csv")
    return read_two_stage(orders, transfer, Future(**future), np.random.default_rng(0), **changes)


def test_today_s_orders_are_what_may_come(sheet):
    scenarios = sheet("scenario,task,count\nbusy,lid,3\nquiet,gear,1\n", "scenarios.csv")
    reading = read(sheet, {"scenarios": scenarios})
    program = reading.program
    assert (program.types, reading.names) == (("gear", "lid"), ("busy", "quiet"))
    assert program.counts.tolist() == [[0, 3], [1, 0]]
    assert program.lesson.tolist() == [0, 1]
    assert program.transfer[0].tolist() == [[0.9, 0.9], [0.5, 0.8]]
    assert program.today.transfer[0].tolist() == program.transfer[0].tolist()


def test_other_tasks_may_come_at_other_costs(sheet):
    """The cog is new: its lesson can be given today; the lid is dearer tomorrow; the gear does not come again."""
    types = sheet("task,c_rob,c_hum,c_fail,c_demo\nlid,10,150,100,210\ncog,5,60,60,90\n", "types.csv")
    scenarios = sheet("scenario,task,count\n1,lid,3\n1,cog,2\n", "scenarios.csv")
    transfer = "taught,tested,p\ngear,lid,0.9\ngear,cog,0.8\nlid,cog,0.5\nlid,lid,0.8\n"
    transfer += "cog,lid,0.1\ncog,cog,0.7\ncog,gear,0.6\n"
    reading = read(sheet, {"scenarios": scenarios, "types": types}, transfer=transfer)
    program = reading.program
    assert program.today.lessons == ("gear", "lid", "cog")
    assert program.today.completes.tolist() == [0, 1, -1]
    assert program.today.c_demo.tolist() == [[120, 200, 90]]
    assert program.c_demo.tolist() == [[120, 210, 90]]
    assert program.c_hum.tolist() == [150, 60]
    assert program.lesson.tolist() == [1, 2]
    assert program.transfer[0].tolist() == [[0.9, 0.8], [0.8, 0.5], [0.1, 0.7]]
    assert program.today.transfer[0, :, 0].tolist() == [1.0, 0.0, 0.6]  # the lid's lesson comes too late for the gear


@pytest.mark.parametrize(
    ("types", "words"),
    [
        ("task,c_rob,c_hum,c_fail,c_demo,decision\nlid,1,1,1,1,act\n", "column 'decision': task 'lid' is decided"),
        ("task,c_rob,c_hum,c_fail,c_demo\nlid,never,never,1,1\n", "row 2: task 'lid' may come 3 times"),
        ("task,c_rob,c_hum,c_fail,c_demo\ngear,1,1,1,1\n", "'lid' is no task that may come"),
    ],
)
def test_what_cannot_come_is_refused(sheet, types, words):
    future = {"scenarios": sheet("scenario,task,count\n1,lid,3\n", "s.csv"), "types": sheet(types, "types.csv")}
    with pytest.raises(InputError) as refused:
        read(sheet, future, fill=0.0)
    assert words in str(refused.value)


def test_a_future_is_one_table():
    for tables in ({}, {"scenarios": "a", "forecast": "b"}, {"forecast": "b", "samples": 0}):
        with pytest.raises(ConfigError):
            Future(**tables)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_samples_have_the_mean_that_was_forecast(seed):
    rng = np.random.default_rng(seed)
    mean = rng.uniform(0, 4, 3)
    forecast = Forecast(
        ("a", "b", "c"), [*mean[:2], 0.7], ("poisson", "geometric", "given"), [[0, 0], [0, 0], [0.3, 0.7]]
    )
    counts = sample_counts(forecast, 4000, rng)
    error = counts.std(axis=0) / np.sqrt(4000)
    assert (np.abs(counts.mean(axis=0) - forecast.mean) <= 6 * error + 1e-3).all()
    assert_allclose(
        sample_counts(forecast, 5, np.random.default_rng(1)), sample_counts(forecast, 5, np.random.default_rng(1))
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mean": [-1.0]}, "at least 0"),
        ({"distribution": ("normal",)}, "expected one of"),
        ({"distribution": ("fixed",)}, "not whole"),
        ({"distribution": ("given",)}, "do not sum to one"),
    ],
)
def test_a_wrong_forecast_is_no_record(changes, words):
    with pytest.raises(ShapeError, match=words):
        Forecast(**{"types": ("a",), "mean": [1.5], "distribution": ("poisson",), "chances": [[0.0]], **changes})


def test_the_gap_is_zero_only_for_the_best_plan():
    program = large_program(12, 30, c_demo=150.0)
    forecast = Forecast(program.types, np.full(12, 1.0), ("poisson",) * 12, np.zeros((12, 1)))
    best = plan_two_stage(program)
    streams = [np.random.default_rng(each) for each in range(6)]
    found = estimate(replicate(best, fresh_samples(program, forecast, 30, streams)), fresh=True)
    assert found.low < found.tomorrow < found.high
    assert 0.0 <= found.gap.mean <= found.gap.upper
    worse = plan_two_stage(with_counts(program, np.zeros((1, 12))))
    streams = [np.random.default_rng(each) for each in range(6)]
    assert (
        estimate(replicate(worse, fresh_samples(program, forecast, 30, streams)), fresh=True).gap.mean > found.gap.mean
    )
    parts = list(subsamples(program, 5, np.random.default_rng(0)))
    assert sum(part.scenarios for part in parts) == program.scenarios
    assert_allclose(sum(part.counts.sum(axis=0) for part in parts), program.counts.sum(axis=0))
    with pytest.raises(ConfigError, match="needs at least 32 scenarios"):
        next(subsamples(program, 16, np.random.default_rng(0)))


def test_the_limit_of_the_gap_by_hand():
    """Gaps 1, 2, 3: mean 2, deviation 1, t(0.95, 2) = 2.919986."""
    limit = gap_interval([11, 12, 13], [10, 10, 10])
    assert (limit.mean, limit.replications) == (2.0, 3)
    assert limit.upper == pytest.approx(2 + 2.919986 / np.sqrt(3), rel=1e-6)
    assert np.isnan(gap_interval([11], [10]).upper)
    for cost, bound, level in (([1, 2], [1], 0.9), ([], [], 0.9), ([1], [1], 1.0), ([np.nan], [1], 0.9)):
        with pytest.raises(ShapeError):
            gap_interval(cost, bound, level)
