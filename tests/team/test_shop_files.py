"""A shop's plan as files and as text: what is written is read, what is changed is refused, what is told is true."""

import csv
import json
from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from shop_instances import small_shop

from benchmarks.instances import large_shop
from p2l.artifacts import load_arrays, save_arrays
from p2l.errors import ArtifactError, ConfigError, InputError, SolverError
from p2l.team.problem import Certificate
from p2l.team.proof_arrays import from_arrays, to_arrays
from p2l.team.shop import Ruling, Shop, check_shop_plan, plan_shop
from p2l.team.shop.explain import break_even_rows, explain_shop, reason_rows
from p2l.team.shop.files import check_shop_place, columns_of, read_shop_plan, settings_of, write_shop_plan
from p2l.team.shop.proof_file import proof_arrays, read_proof
from p2l.team.shop.reasons import Reasons, reasons_of
from p2l.team.shop.reasons_check import check_reasons
from p2l.team.shop.record import ShopCertificate

NO_REASONS = Reasons(np.nan, (), (), 0)
REFUSED = (ArtifactError, InputError, SolverError)


def day(**changes):
    """Two gears and five lids: a lesson on either gear is enough for the lids.

    Nobody has a skill, so that an attempt costs 110 without a lesson and the person 100: 700 in all. Taught the gear,
    lids cost 10 + 0.1 · 100 each: 120 + 100 + 5 · 20 = 320. Taught the cog, they cost 10 + 0.15 · 100: 355. With both
    lessons: 350.
    """
    parts = {
        "tasks": ("gear", "cog", "lid"), "robots": ("Panda",), "lessons": ("gear", "cog", "lid"),
        "completes": np.arange(3), "count": np.array([1, 1, 5]), "c_hum": np.full(3, 100.0),
        "c_rob": np.full((1, 3), 10.0), "c_fail": np.full((1, 3), 100.0), "pretrained": np.zeros((1, 3)),
        "c_demo": np.array([[120.0, 130.0, 200.0]]),
        "transfer": np.array([[[1.0, 0.0, 0.9], [0.0, 1.0, 0.85], [0.0, 0.0, 0.0]]]), "choice": np.full(3, Ruling.FREE),
    }  # fmt: skip
    return Shop(**(parts | changes))


def course():
    """The day with two robots, and a lesson that is on none of its tasks: 40, and any lid costs Ada 10 + 5."""
    both = day()
    return replace(
        both, robots=("Panda", "Ada"), lessons=(*both.lessons, "course"), completes=np.array([0, 1, 2, -1]),
        c_demo=np.array([[120.0, 130.0, 200.0, np.inf], [np.inf, np.inf, np.inf, 40.0]]),
        **{name: np.repeat(getattr(both, name), 2, axis=0) for name in ("c_rob", "c_fail", "pretrained")},
        transfer=np.concatenate([np.repeat(both.transfer, 2, axis=0), np.full((2, 1, 3), [0.0, 0.0, 0.95])], axis=1),
    )  # fmt: skip


SHOPS = {
    "copies": day,
    "a catalogue and two robots": course,
    "two robots": lambda: large_shop(30, 2, seed=1),
    "a limit of lessons": lambda: large_shop(60, seed=2, max_lessons=2.0),
    "a limit of teaching": lambda: large_shop(30, seed=2, max_teaching=500.0),
    "a partial order": lambda: large_shop(25, seed=3, arcs=30),
    "any order": lambda: large_shop(20, seed=4, order="any"),
}


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def read(folder, shop, extra=None):
    made = read_shop_plan(folder, shop, extra)
    return made, check_shop_plan(shop, made)


@pytest.mark.parametrize("kind", SHOPS)
def test_what_is_written_is_read_and_true(tmp_path, kind):
    shop = SHOPS[kind]()
    made = plan_shop(shop)
    write_shop_plan(tmp_path, shop, made, NO_REASONS, remarks=("assumed",))
    back, verdict = read(tmp_path, shop)
    for name in ("taught", "sequence", "decision", "robot", "lesson", "p_success", "expected_cost"):
        np.testing.assert_array_equal(getattr(back, name), getattr(made, name))
    assert verdict == check_shop_plan(shop, made)
    assert verdict.optimal
    limits = [each if np.isfinite(each) else None for each in (shop.max_lessons, shop.max_teaching)]
    assert settings_of(tmp_path) == ("any" if shop.order == "any" else "fixed", *limits)
    table = rows_of(tmp_path / "plan.csv")
    assert sum(float(row["expected_cost"]) for row in table) == pytest.approx(made.objective)
    assert sum(int(row.get("count") or 1) for row in table if row["task"] in shop.tasks) == shop.count.sum()


@pytest.mark.parametrize("order", ["fixed", "any", "partial"])
def test_small_shops_of_all_kinds_come_back(tmp_path, order):
    back = 0
    for seed in range(25):
        shop = small_shop(np.random.default_rng(seed), order)
        try:
            made = plan_shop(shop)
        except ConfigError:  # its limits cannot be kept
            continue
        write_shop_plan(tmp_path, shop, made, NO_REASONS)
        assert read(tmp_path, shop)[1].optimal
        back += 1
    assert back > 10


def test_the_table_in_figures(tmp_path):
    shop = course()
    made = plan_shop(shop)  # the person does the gear and the cog: 40 + 200 + 5 · 15
    write_shop_plan(tmp_path, shop, made, NO_REASONS)
    assert (tmp_path / "plan.csv").read_text().splitlines() == [
        "order,task,count,decision,robot,skill,p_success,expected_cost",
        "1,course,1,learn,Ada,course,1,40",
        "2,gear,1,delegate,,,1,100",
        "3,cog,1,delegate,,,1,100",
        "4,lid,5,act,Ada,course,0.95,75",
    ]
    summary = json.loads((tmp_path / "plan.json").read_text())
    assert summary["lessons"] == [{"lesson": "course", "robot": "Ada", "c_demo": 40.0}]
    assert [summary[name] for name in ("n_tasks", "n_act", "n_delegate", "n_learn")] == [7, 5, 2, 0]


def test_columns_are_there_where_they_say_something():
    rest = ["decision", "skill", "p_success", "expected_cost"]
    assert columns_of(day(count=np.ones(3))) == ["order", "task", *rest]
    assert columns_of(day()) == ["order", "task", "count", *rest]
    assert columns_of(course()) == ["order", "task", "count", "decision", "robot", *rest[1:]]
    assert columns_of(replace(course(), count=np.ones(3))) == ["order", "task", "decision", "robot", *rest[1:]]


def test_a_person_s_own_columns_stay_and_no_spreadsheet_runs_them(tmp_path):
    shop = replace(course(), tasks=("gear", "cog", "=lid"), lessons=("gear", "cog", "=lid", "@course"))
    extra = {"bay": ("A", "", "=1+1"), "note": ("two\r\nlines", "a,b", '"'), "order": ("77", "78", "79"),
             "+sum": ("", "", "")}  # fmt: skip
    made = plan_shop(shop)
    write_shop_plan(tmp_path, shop, made, NO_REASONS, extra=extra)
    course_, gear, _, lid = rows_of(tmp_path / "plan.csv")
    assert (course_["task"], course_["bay"], course_["order (given)"]) == ("'@course", "", "")
    assert (gear["bay"], gear["note"], gear["order"], gear["order (given)"]) == ("A", "two\r\nlines", "2", "77")
    assert (lid["task"], lid["skill"], lid["bay"], lid["note"]) == ("'=lid", "'@course", "'=1+1", '"')
    assert "'+sum" in lid
    assert read(tmp_path, shop, extra)[1].optimal
    with pytest.raises(InputError, match=r"plan.csv, row \d: is not what plan.json says"):
        read_shop_plan(tmp_path, shop, extra | {"bay": ("A", "B", "=1+1")})


def with_group(summary, name, value):
    summary["groups"][name] = value


CHANGES = {
    "objective": lambda plan: plan.update(objective=plan["objective"] - 1.0),
    "lower_bound": lambda plan: plan.update(lower_bound=plan["lower_bound"] + 1.0),
    "status": lambda plan: plan.update(status="feasible"),
    "an unknown status": lambda plan: plan.update(status="perfect"),
    "gap": lambda plan: plan.update(gap=0.5),
    "no number": lambda plan: plan.update(objective=True),
    "order": lambda plan: plan.update(order="any"),
    "a limit": lambda plan: plan.update(max_lessons=1.0),
    "a count": lambda plan: plan.update(n_learn=0),
    "a lesson": lambda plan: plan["lessons"][0].update(c_demo=1.0),
    "a row": lambda plan: plan["plan"][0].update(expected_cost=1.0),
    "a decision": lambda plan: with_group(plan, "decision", [1, *plan["groups"]["decision"][1:]]),
    "a probability": lambda plan: with_group(plan, "p_success", [0.5, *plan["groups"]["p_success"][1:]]),
    "a cost": lambda plan: with_group(plan, "expected_cost", [1.0, *plan["groups"]["expected_cost"][1:]]),
    "a sequence": lambda plan: with_group(plan, "sequence", plan["groups"]["sequence"][::-1]),
    "no such group": lambda plan: with_group(plan, "sequence", [9, *plan["groups"]["sequence"][1:]]),
    "other lessons": lambda plan: with_group(plan, "taught", [[1, 0]]),
    "no such lesson": lambda plan: with_group(plan, "taught", [[7, 0]]),
    "text": lambda plan: with_group(plan, "robot", ["a", "b"]),
    "no groups": lambda plan: plan.pop("groups"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_of_the_summary_is_refused(tmp_path, change):
    shop = day()
    write_shop_plan(tmp_path, shop, plan_shop(shop), NO_REASONS)
    path = tmp_path / "plan.json"
    summary = json.loads(path.read_text())
    CHANGES[change](summary)
    path.write_text(json.dumps(summary))
    with pytest.raises(REFUSED):
        read(tmp_path, shop)


@pytest.mark.parametrize("name", ["p_success", "expected_cost"])
def test_a_lie_that_all_files_tell_is_refused(tmp_path, name):
    shop = day()
    made = plan_shop(shop)
    values = getattr(made, name).copy()
    values[-1] *= 0.9
    write_shop_plan(tmp_path, shop, replace(made, **{name: values}), NO_REASONS)
    with pytest.raises(SolverError, match=f"{name} of a task is not what the shop gives"):
        read(tmp_path, shop)


@pytest.mark.parametrize(("old", "new"), [(",20,", ",19,"), ("delegate", "act"), ("1,gear", "1,cog"), ("\n3,", "\n4,")])
def test_a_change_of_the_table_is_refused(tmp_path, old, new):
    shop = day(count=np.ones(3), c_demo=np.array([[120.0, 130.0, 200.0]]) / 5)
    write_shop_plan(tmp_path, shop, plan_shop(shop), NO_REASONS)
    path = tmp_path / "plan.csv"
    text = path.read_text().replace("\n3,lid,act,gear,0.9,20", "\n3,lid,act,gear,0.9,20,")
    changed = text.replace(old, new) if old in text else text + "4,more,act,,1,1\n"
    path.write_text(changed)
    with pytest.raises(InputError, match=r"plan\.csv(, row \d)?: is not what plan\.json says"):
        read(tmp_path, shop)


@pytest.mark.parametrize(
    ("kind", "name", "change"),
    [
        ("a limit of lessons", "0/prices", lambda value: value + 50.0),
        ("a limit of lessons", "0/prices", lambda value: -value),
        ("copies", "0/multipliers", lambda value: value * 1.5),
        ("copies", "0/multipliers", lambda value: value[:, :-1]),
        ("copies", "parent", lambda value: value + 1),
        ("copies", "0/target", lambda value: np.repeat(value, 2)),
        ("a partial order", "0/multipliers", lambda value: value * 0.5),
    ],
)
def test_a_change_of_the_proof_is_refused(tmp_path, kind, name, change):
    shop = SHOPS[kind]()
    write_shop_plan(tmp_path, shop, plan_shop(shop), NO_REASONS)
    path = tmp_path / "certificate.npz"
    arrays = dict(load_arrays(path, schema="shop_certificate", version=1))
    arrays[name] = change(arrays[name])
    save_arrays(path, arrays, schema="shop_certificate", version=1)
    with pytest.raises(REFUSED):
        read(tmp_path, shop)


def test_a_proof_by_how_many_are_open_is_whole_in_both_files(tmp_path):
    """What every opening counts less was left out of the files, and a plan that was proven so refused."""
    leaf = Certificate(
        np.array([[1.0, 2.0], [1.5, 2.5]]), np.array([0, 1, 0]), np.array([-1, 0, 0]), np.array([-1, 4, 4]),
        np.array([False, True, False]), 3.0, count_prices=np.array([0.0, 0.5]),
    )  # fmt: skip
    proof = ShopCertificate(np.array([-1]), np.array([-1]), np.array([-1]), (leaf,))
    save_arrays(tmp_path / "shop.npz", proof_arrays(proof), schema="shop_certificate", version=1)
    [again] = read_proof(tmp_path / "shop.npz").leaf
    for one in (again, from_arrays(to_arrays(leaf))):
        for field in fields(Certificate):
            assert_array_equal(getattr(one, field.name), getattr(leaf, field.name))


def test_what_is_missing_or_damaged_is_refused(tmp_path):
    shop = day()
    made = plan_shop(shop)
    for name, problem in (
        ("plan.json", "plan.json"), ("plan.csv", "plan.csv"), ("certificate.npz", "certificate: none given"),
    ):  # fmt: skip
        write_shop_plan(tmp_path, shop, made, NO_REASONS)
        (tmp_path / name).unlink()
        with pytest.raises(REFUSED, match=problem):
            read(tmp_path, shop)
        write_shop_plan(tmp_path, shop, made, NO_REASONS)
        (tmp_path / name).write_bytes(b"\xff{")
        with pytest.raises(REFUSED, match=name):
            read(tmp_path, shop)


def test_a_plan_of_another_day_is_refused(tmp_path):
    shop = day()
    write_shop_plan(tmp_path, shop, plan_shop(shop), NO_REASONS)
    for other in (
        day(tasks=("gear", "cog", "nut")), day(count=np.array([1, 1, 4])), day(order="any"), large_shop(3),
        day(c_hum=np.full(3, 101.0)), day(c_demo=np.array([[119.0, 130.0, 200.0]])), day(max_lessons=5.0),
    ):  # fmt: skip
        with pytest.raises(REFUSED):
            read(tmp_path, other)


def test_what_a_plan_is_made_from_is_not_overwritten(tmp_path):
    """Not even where it is a plan of ours; what is not is the stage's to refuse."""
    shop, inputs = day(), tmp_path / "plan.csv"
    inputs.write_text("task,c_rob\n")
    with pytest.raises(ArtifactError, match="is a file"):
        check_shop_place(inputs)
    inputs.unlink()
    for name in ("plan.json", "plan.html", "plan.png", "reasons.csv", "certificate.npz"):
        (tmp_path / name).write_text("mine")
        with pytest.raises(ArtifactError, match=f"{name}: is an input, and the plan would overwrite it"):
            check_shop_place(tmp_path, [tmp_path / "gone.csv", tmp_path / name])
        (tmp_path / name).unlink()
    write_shop_plan(tmp_path, shop, plan_shop(shop), NO_REASONS, extra={"bay": ("A", "B", "C")})
    check_shop_place(tmp_path)  # a plan takes the place of a plan
    with pytest.raises(ArtifactError, match="is an input"):
        check_shop_place(tmp_path, [inputs])
    check_shop_place(tmp_path / "new")


def test_a_lesson_with_a_near_substitute_saves_little_and_alone_it_saves_much(tmp_path):
    """Without the gear's lesson the cog's is given: 355. Without both: 700. Both are, if the cog costs below 100."""
    shop = day()
    made = plan_shop(shop)
    reasons = reasons_of(shop, made)
    assert explain_shop(shop, made, reasons).splitlines() == [
        "Expected cost 320.0 (proven optimal); without any lesson 700.0. 5 act, 1 delegate, 1 learn.",
        "lesson  costs  pays for  saving  others kept fixed  given up to",
        "------  -----  --------  ------  -----------------  -----------",
        "gear    120.0  lid ×5      35.0              380.0        155.0",
        "No other lesson pays; cog would below 100.0, lid would below 20.0.",
    ]
    [row] = reason_rows(shop, reasons)
    assert (row["saving_resolved"], row["saving_others_fixed"], row["stays_up_to"]) == pytest.approx((35, 380, 155))
    assert row["serves"] == "lid ×5"
    assert [(each["lesson"], each["pays_below"]) for each in break_even_rows(shop, reasons)] == [
        ("cog", pytest.approx(100.0)), ("lid", pytest.approx(20.0)),
    ]  # fmt: skip
    write_shop_plan(tmp_path, shop, made, reasons)
    assert (tmp_path / "reasons.csv").read_text(encoding="utf-8").splitlines() == [
        "lesson,robot,given,c_demo,serves,saving,saving_others_fixed,given_below",
        "gear,Panda,yes,120,lid ×5,35,380,155",
        "cog,Panda,no,130,,,,100",
        "lid,Panda,no,200,,,,20",
    ]


def test_no_lesson_pays_and_what_one_would_have_to_cost():
    """The person needs 50 for the gear and 36 for the lid, which a robot with the gear's skill does for 20."""
    shop = day(count=np.ones(3), c_hum=np.array([50.0, 0.0, 36.0]), choice=np.array([Ruling.FREE, 1, Ruling.NOT_LEARN]))
    made = plan_shop(shop)
    assert explain_shop(shop, made, reasons_of(shop, made)).splitlines() == [
        "Expected cost 86.0 (proven optimal); without any lesson 86.0. 0 act, 3 delegate, 0 learn.",
        "No lesson pays; gear would below 66.0.",
    ]


def test_robots_are_named_where_there_are_several():
    shop = course()
    made = plan_shop(shop)
    told = explain_shop(shop, made, reasons_of(shop, made)).splitlines()
    assert told[1].split()[:3] == ["lesson", "robot", "costs"]
    assert told[3].split()[:4] == ["course", "Ada", "40.0", "lid"]
    assert "gear to " in told[-1]


def test_a_lesson_without_which_nothing_goes_is_needed_and_no_time_is_said():
    shop = day(choice=np.array([Ruling.LEARN, Ruling.FREE, Ruling.FREE]), c_hum=np.array([np.inf, 100.0, 100.0]))
    made = plan_shop(shop)
    told = explain_shop(shop, made, reasons_of(shop, made)).splitlines()
    assert "without any lesson not possible" in told[0]
    assert told[3].split()[-3:] == ["needed", "needed", "needed"]
    hurried = explain_shop(shop, made, reasons_of(shop, made, time_limit_s=0.0))
    assert "without any lesson not known" in hurried
    assert "no time to solve again for 3 lessons" in hurried


def with_reasons(folder, shop, time_limit_s=10.0):
    made = plan_shop(shop)
    write_shop_plan(folder, shop, made, reasons_of(shop, made, time_limit_s=time_limit_s))
    return made


@pytest.mark.parametrize("kind", SHOPS)
def test_reasons_that_are_solved_for_again_are_the_same(tmp_path, kind):
    shop = SHOPS[kind]()
    made = with_reasons(tmp_path, shop)
    rows = rows_of(tmp_path / "reasons.csv")
    assert rows
    numbers = sum(
        bool(row[name]) for row in rows for name in ("c_demo", "saving", "saving_others_fixed", "given_below")
    )
    assert check_reasons(tmp_path, shop, made, time_limit_s=10.0) == (1 + numbers, 0)
    (tmp_path / "reasons.csv").unlink()
    assert check_reasons(tmp_path, shop, made, time_limit_s=10.0) is None


@pytest.mark.parametrize(
    ("line", "column", "value"),
    [
        (0, "saving", "0"), (0, "saving", "lots"), (0, "saving_others_fixed", "1e3"), (0, "c_demo", "1"),
        (0, "given_below", "1"), (0, "serves", "cog"), (0, "lesson", "bolt"), (0, "given", "no"), (0, "robot", "Eve"),
        (1, "given_below", "99.9"), (1, "given_below", "nan"), (1, "c_demo", ""), (1, "lesson", "gear"),
    ],
)  # fmt: skip
def test_a_change_of_the_reasons_is_refused(tmp_path, line, column, value):
    """The gear is taught (120) for the lids, which saves 700 - 420; the cog would be below 120."""
    shop = day()
    made = with_reasons(tmp_path, shop)
    path = tmp_path / "reasons.csv"
    rows = rows_of(path)
    assert [(row["lesson"], row["given"]) for row in rows[:2]] == [("gear", "yes"), ("cog", "no")]
    if (line, column) == (1, "c_demo"):
        rows.pop(line)  # a row that is missing
    else:
        rows[line][column] = value
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    with pytest.raises(REFUSED, match=r"reasons.csv"):
        check_reasons(tmp_path, shop, made, time_limit_s=10.0)


def test_the_cost_without_lessons_is_checked_and_what_nobody_had_time_for_is_counted(tmp_path):
    shop = day()
    made = with_reasons(tmp_path, shop)
    path = tmp_path / "plan.json"
    summary = json.loads(path.read_text())
    assert (summary["without_lessons"], summary["unknown_reasons"]) == (700.0, 0)
    for told in (699.0, None, "many"):
        path.write_text(json.dumps(summary | {"without_lessons": told}))
        with pytest.raises(InputError, match="its 'without_lessons' is"):
            check_reasons(tmp_path, shop, made, time_limit_s=10.0)
    with_reasons(tmp_path, shop, time_limit_s=1e-9)
    checked = check_reasons(tmp_path, shop, made, time_limit_s=10.0)
    assert checked.unknown > 0
    assert json.loads(path.read_text())["unknown_reasons"] > 0
    with_reasons(tmp_path, shop)
    assert check_reasons(tmp_path, shop, made, time_limit_s=1e-9).unknown > 0


def test_with_a_limit_of_teaching_no_cost_is_told_up_to_which_a_lesson_is_given(tmp_path):
    """The gear's lesson saves 35 beside the cog's, but from 121 on it takes more than the limit has left."""
    shop = day(max_teaching=120.0)
    made = with_reasons(tmp_path, shop)
    told = explain_shop(shop, made, reasons_of(shop, made))
    assert "gear" in told
    assert "saving" in told
    assert "given up to" not in told
    [row] = rows_of(tmp_path / "reasons.csv")
    assert (row["lesson"], row["given_below"]) == ("gear", "")
    assert plan_shop(replace(shop, c_demo=np.array([[121.0, 130.0, 200.0]]))).taught.tolist() == []
    path = tmp_path / "reasons.csv"
    whole = path.read_text(encoding="utf-8")
    path.write_text(whole.rstrip("\n") + "500\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"reasons.csv, row 2, column 'given_below': '500' is there"):
        check_reasons(tmp_path, shop, made, time_limit_s=10.0)
    path.write_text(whole + "cog,Panda,no,130,,,,100\n", encoding="utf-8")
    with pytest.raises(InputError, match="'cog' is no such lesson"):
        check_reasons(tmp_path, shop, made, time_limit_s=0.0)


def test_what_cannot_be_taught_would_not_be_below_any_cost():
    """Free, the cog's lesson would be given, if there were one; Ada can be taught the course alone."""
    shop = day(c_demo=np.array([[120.0, np.inf, 200.0]]))
    reasons = reasons_of(shop, plan_shop(shop))
    assert [shop.lessons[each.lesson] for each in reasons.not_given] == ["lid"]
    shop = course()
    reasons = reasons_of(shop, plan_shop(shop))
    assert reasons.not_given
    assert all(np.isfinite(each.c_demo) for each in reasons.not_given)


@pytest.mark.parametrize("limit", ["-1", '"two"', "1" + "0" * 400, "NaN"])
def test_a_limit_that_is_none_is_refused(tmp_path, limit):
    shop = day(max_lessons=2.0)
    write_shop_plan(tmp_path, shop, plan_shop(shop), NO_REASONS)
    path = tmp_path / "plan.json"
    path.write_text(path.read_text(encoding="utf-8").replace('"max_lessons": 2.0', f'"max_lessons": {limit}'))
    with pytest.raises(ArtifactError, match="its order or its limits are unknown"):
        settings_of(tmp_path)


@pytest.mark.parametrize(
    ("limits", "text"),
    [
        ({"max_lessons": 0.0}, "because of max_lessons=0: without, some pay, and the day costs 320.0."),
        ({"max_teaching": 119.0}, "because of max_teaching=119: without, some pay, and the day costs 320.0."),
        (
            {"max_lessons": 3.0, "max_teaching": 119.0},
            "because of max_lessons=3 and max_teaching=119: without, some pay, and the day costs 320.0.",
        ),
        (
            {"max_teaching": 9.0, "c_demo": np.full((1, 3), 999.0)},
            "No lesson pays for itself, without max_teaching=9 neither.",
        ),
    ],
)
def test_a_limit_that_leaves_no_lesson_is_named_and_what_it_costs(limits, text):
    """Without limits the gear is taught for five lids, and not for 999."""
    shop = day(**limits)
    made = plan_shop(shop)
    reasons = reasons_of(shop, made)
    assert explain_shop(shop, made, reasons).splitlines()[-1].endswith(text)
    hurried = explain_shop(shop, made, replace(reasons, without_limits=np.nan))
    assert "there was no time to find out" in hurried
