import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from p2l.errors import InputError
from p2l.team.cells import Sheet, decimal_mark, flag, number, probability, whole_number
from p2l.team.sheets import read_sheet

POINT, COMMA = Sheet("t.csv", ("task", "cost"), (), False), Sheet("t.csv", ("task", "cost"), (), True)
UNCLEAR = Sheet("t.csv", ("task", "cost"), (), False, unclear=".,")


def outcome(read, sheet, text):
    try:
        return read(sheet, 2, "cost", text)
    except InputError as error:
        return str(error)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("95", 95), ("1.5", 1.5), ("+2", 2), ("1e3", 1000), ("1.5E-2", 0.015), (".5", 0.5), ("5.", 5), ("007", 7),
        ("0", 0), ("-0", 0), ("1.234", 1.234), ("1,234", 1234), ("1,234.5", 1234.5), ("1,234,567", 1234567),
        ("1'234.5", 1234.5), ("1’234’567", 1234567), ("1 234.5", 1234.5), ("1\u00a0234", 1234),
        ("1\u202f234.25", 1234.25),
        ("inf", math.inf), ("Infinity", math.inf), ("∞", math.inf), ("NEVER", math.inf), ("-", math.inf),
        ("–", math.inf),
        ("", math.inf), ("1e100", 1e100), ("0.1", 0.1), ("1234567890.123456789", 1234567890.123456789),
    ],
)  # fmt: skip
def test_a_cost_with_a_decimal_point(text, value):
    assert number(POINT, 2, "cost", text) == value
    assert math.copysign(1, number(POINT, 2, "cost", text)) == 1


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("95", 95), ("1,5", 1.5), ("1.234,5", 1234.5), ("1.234.567", 1234567), ("1.234", 1234), ("1,234", 1.234),
        ("1 234,5", 1234.5), ("1\u00a0234,5", 1234.5), ("1\u202f234\u202f567", 1234567), ("1'234,5", 1234.5),
        (",5", 0.5), ("1,5e3", 1500), ("∞", math.inf), ("", math.inf),
    ],
)  # fmt: skip
def test_a_cost_with_a_decimal_comma(text, value):
    assert number(COMMA, 2, "cost", text) == value


@pytest.mark.parametrize(
    ("sheet", "text", "problem"),
    [
        *((POINT, text, "is not a number; give a cost of at least 0 and at most 1e100, or inf for never")
          for text in ("1_0", "ten", "0x10", "1e", "--1", "1 2", "1,23,456", "1,2345.6", "1.5.2", "12 €", "95%",
                       "1'2", "٣", ".", ",", "e5", "#N/A", "TRUE", "1e99999999999", "2024-01-31", "- 1", "1,234'567")),
        *((POINT, text, "is not allowed; give a cost of at least 0 and at most 1e100, or inf for never")
          for text in ("-1", "−1", "-0.5", "nan", "NaN", "-inf", "1e101", "1e400")),
        (POINT, "1,5", "has a decimal comma, and numbers of this file a decimal point; give a cost"),
        (POINT, "0,950", "has a decimal comma"),
        (COMMA, "1.5", "has a decimal point, and numbers of this file a decimal comma; give a cost"),
        (COMMA, "1,234.5", "has a decimal point"),
        (UNCLEAR, "1.234", "may be 1234 or 1.234, and no other number of the file tells"),
        (UNCLEAR, "1,234", "may be 1234 or 1.234"),
        (UNCLEAR, "12,345", "may be 12345 or 12.345"),
    ],
)  # fmt: skip
def test_what_is_no_cost_gets_one_message(sheet, text, problem):
    with pytest.raises(InputError) as caught:
        number(sheet, 7, "cost", text)
    assert f"t.csv, row 7, column 'cost': '{text}' {problem}" in str(caught.value)


@pytest.mark.parametrize("text", ["1\n2", "x" * 10_000, "\x1b[31m"])
def test_a_message_stays_on_one_line(text):
    with pytest.raises(InputError) as caught:
        number(POINT, 7, None, text)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300


def test_what_is_allowed_is_for_the_caller_to_say():
    assert number(POINT, 2, "cost", "", empty=3.0) == 3.0
    for text, options in (("", {"empty": None}), ("never", {"never": False}), ("11", {"largest": 10.0})):
        with pytest.raises(InputError, match=f"'{text}' is not"):
            number(POINT, 2, "cost", text, **options)
    with pytest.raises(InputError, match="'inf' is not allowed; give a number from 0 to 10"):
        number(POINT, 2, "cost", "inf", largest=10, never=False)


@pytest.mark.parametrize(
    ("sheet", "text", "value"),
    [
        (POINT, "0.95", 0.95), (POINT, "95%", 0.95), (POINT, "95 %", 0.95), (POINT, "33.3\u00a0%", 0.333),
        (POINT, "1", 1), (POINT, "0", 0), (POINT, "100%", 1), (POINT, "1e-3", 0.001), (POINT, "1e1%", 0.1),
        (COMMA, "0,95", 0.95), (COMMA, "95,5 %", 0.955), (COMMA, "1", 1), (UNCLEAR, "0.950", 0.95),
    ],
)  # fmt: skip
def test_a_probability(sheet, text, value):
    assert probability(sheet, 2, "p", text) == value


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("95", "is not allowed; give a probability in [0, 1], such as 0.95 or 95 %; if 95 of a hundred is meant"),
        ("101%", "is not allowed; give a probability in [0, 1], such as 0.95 or 95 %"),
        ("101", "is not allowed; give a probability in [0, 1], such as 0.95 or 95 %"),
        ("-0.1", "is not allowed"), ("-5%", "is not allowed"), ("nan", "is not allowed"), ("inf", "is not allowed"),
        ("", "is not a number"), ("%", "is not a number"), ("-", "is not a number"), ("never", "is not a number"),
        ("5%%", "is not a number"), ("0,95", "has a decimal comma"),
    ],
)  # fmt: skip
def test_what_is_no_probability_gets_one_message(text, problem):
    with pytest.raises(InputError) as caught:
        probability(POINT, 2, "p", text)
    assert f"t.csv, row 2, column 'p': '{text}' {problem}" in str(caught.value)
    assert ("write" in str(caught.value)) == (text == "95")


def test_an_empty_probability_is_what_the_caller_says():
    assert probability(POINT, 2, "p", "", empty=0.5) == 0.5


def test_a_count():
    texts = {"12": 12, "12.0": 12, "1,200": 1200, "1'200": 1200, "0": 0, "1e3": 1000}
    assert {text: whole_number(POINT, 2, "n", text) for text in texts} == texts
    assert whole_number(COMMA, 2, "n", "1.200") == 1200
    assert whole_number(POINT, 2, "n", "", empty=1) == 1
    for text in ("1.5", "-1", "nan", "1e10", "", "two", "1_0", "inf", "0x1"):
        with pytest.raises(InputError, match=f"row 2, column 'n': '{text}' is not .*; give a whole number from 0 to"):
            whole_number(POINT, 2, "n", text)


def test_yes_and_no():
    for text in ("yes", "Y", "ja", "J", "true", "TRUE", "Wahr", "1", "x", "X", "on"):
        assert flag(POINT, 2, "can", text) is True
    for text in ("no", "N", "nein", "false", "FALSCH", "0", "-", "off", ""):
        assert flag(POINT, 2, "can", text) is False
    assert flag(POINT, 2, "can", "", empty=True) is True
    for text, options in (("2", {}), ("maybe", {}), ("", {"empty": None})):
        with pytest.raises(InputError, match=f"t.csv, row 2, column 'can': '{text}' is neither yes nor no; give yes"):
            flag(POINT, 2, "can", text, **options)


@pytest.mark.parametrize(
    ("text", "decimal_comma", "unclear"),
    [
        ("task;cost\nlid;1,5\n", True, ""),
        ("task;cost\nlid;1.5\n", False, ""),
        ("task;cost\nlid;1.234,5\nbox;1.234\n", True, ""),
        ("task;cost\nlid;0,950\n", True, ""),
        ("task;cost\nlid;1.234.567\n", True, ""),
        ("task;cost\nlid;1,234,567\n", False, ""),
        ("task|cost\nlid|1,234.5\n", False, ""),
        ("task\tcost\nlid\t95,5 %\n", True, ""),
        ("task;cost\nlid;95\n", False, ".,"),
        ("task;cost\nlid;1.234\nbox;1,234\n", False, ".,"),
        ("task;cost\nlid;1,5\nbox;1.5\n", True, ".,"),
        ("task;cost\n1.1;1,5\n1.10;2,25\n", True, ""),
        ("id;task;cost\n1;1.1;1,5\n", True, ""),
        ("cost;who\n1,5;me\n", True, ""),
        ("task;cost\n1,5 mm;31.12.24\n", False, ".,"),
        ("task;cost\n1,5;0.5\n", False, ""),
        ('task,cost\nlid,"1,234"\n', False, ""),
        ('task,cost\nlid,"1,5"\n', False, ","),
        ("task,cost\nlid,1.234\n", False, ""),
    ],
)
def test_the_decimal_mark_is_a_matter_of_the_file(tmp_path, text, decimal_comma, unclear):
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    sheet = read_sheet(tmp_path / "t.csv")
    assert (sheet.decimal_comma, sheet.unclear) == (decimal_comma, unclear)


def test_numbers_that_contradict_each_other_are_refused(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("task;a;b;c\nlid;1,5;0.5;1.234\n")
    sheet = read_sheet(path)
    (line, cells), *_ = sheet.rows
    assert number(sheet, line, "a", cells[1]) == 1.5
    with pytest.raises(InputError, match=r"row 2, column 'b': '0.5' has a decimal point"):
        number(sheet, line, "b", cells[2])
    with pytest.raises(InputError, match=r"row 2, column 'c': '1.234' may be 1234 or 1.234"):
        number(sheet, line, "c", cells[3])


def written(value, decimals, group, comma):
    text = f"{value:,.{decimals}f}"
    return text.replace(",", "G").replace(".", "," if comma else ".").replace("G", group)


@given(
    values=st.lists(st.floats(0, 1e9), min_size=1, max_size=8),
    decimals=st.integers(0, 4),
    group=st.sampled_from(["", "'", "\u00a0", "\u202f", "mark"]),
    comma=st.booleans(),
)
def test_any_number_that_is_written_is_read_or_refused_but_never_another(values, decimals, group, comma):
    group = ("." if comma else ",") if group == "mark" else group
    texts = [written(value, decimals, group, comma) for value in values]
    decimal_comma, unclear = decimal_mark(("task", "cost"), [("a", text) for text in texts], comma_possible=True)
    sheet = Sheet("t.csv", ("task", "cost"), (), decimal_comma, unclear=unclear)
    for value, text in zip(values, texts, strict=True):
        found = outcome(number, sheet, text)
        if isinstance(found, str):
            assert "may be" in found
            assert unclear
        else:
            assert found == float(f"{value:.{decimals}f}")


@given(st.text("0123456789.,'_-+eE% xnaif∞", max_size=8), st.booleans())
def test_any_text_is_a_number_in_range_or_refused(text, comma):
    sheet = COMMA if comma else POINT
    for read, largest in ((number, math.inf), (probability, 1.0)):
        found = outcome(read, sheet, text)
        assert f"'{text}'" in found if isinstance(found, str) else 0 <= found <= largest
