import datetime
import io
import math
import sys
import zipfile

import pytest

from p2l.errors import InputError
from p2l.team.cells import number, probability
from p2l.team.files import read_problem
from p2l.team.sheets import read_sheet
from p2l.team.shop.orders import read_orders

openpyxl = pytest.importorskip("openpyxl")


def saved(path, change=None, sheets=1):
    book = openpyxl.Workbook()
    book.active.title = "Orders"
    for each in range(1, sheets):
        book.create_sheet(f"Sheet {each}")
    if change:
        change(book)
    book.save(path)
    return path


def filled(rows, sheet=0):
    def change(book):
        for row in rows:
            book.worksheets[sheet].append(row)

    return change


def rewritten(path, old, new):
    """The workbook with a change in the XML of its first sheet that openpyxl would not write."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    assert old in parts["xl/worksheets/sheet1.xml"]
    parts["xl/worksheets/sheet1.xml"] = parts["xl/worksheets/sheet1.xml"].replace(old, new)
    with zipfile.ZipFile(path, "w") as archive:
        for name, part in parts.items():
            archive.writestr(name, part)
    return path


def test_values_become_text_in_full_precision(tmp_path):
    values = [
        1,
        1 / 3,
        1e22,
        True,
        False,
        datetime.date(2024, 1, 31),
        datetime.datetime(2024, 1, 31, 8, 30),
        " a\nb ",
    ]
    texts = ["1", "0.3333333333333333", "1e+22", "TRUE", "FALSE", "2024-01-31", "2024-01-31 08:30:00", "a\nb"]
    rows = [("kind", "value"), *((type(value).__name__, value) for value in values)]
    sheet = read_sheet(saved(tmp_path / "a.xlsx", filled(rows)))
    assert sheet.header == ("kind", "value")
    assert [cells[1] for _, cells in sheet.rows] == texts
    assert [line for line, _ in sheet.rows] == list(range(2, 10))
    assert number(sheet, 3, "value", texts[1]) == 1 / 3


def test_blank_rows_and_columns_and_a_late_start_are_understood(tmp_path):
    def change(book):
        sheet = book.active
        for place, value in {"B3": "task", "C3": "p", "B5": "lid", "C5": 0.95, "B6": "box", "C6": "95 %"}.items():
            sheet[place] = value
        sheet["H40"].font = openpyxl.styles.Font(bold=True)
        sheet["C5"].number_format = "0%"

    sheet = read_sheet(saved(tmp_path / "a.xlsx", change))
    assert (sheet.header, sheet.header_line) == (("task", "p"), 3)
    assert sheet.rows == ((5, ("lid", "0.95")), (6, ("box", "95 %")))
    assert [probability(sheet, line, "p", cells[1]) for line, cells in sheet.rows] == [0.95, 0.95]


def test_the_sheet_is_the_first_visible_one_or_the_one_that_is_named(tmp_path):
    def change(book):
        for each, sheet in enumerate(book.worksheets):
            sheet.append(("task", "c_rob"))
            sheet.append((f"task {each}", each))
        book.worksheets[0].sheet_state = "hidden"

    path = saved(tmp_path / "a.xlsx", change, sheets=3)
    names = {"": "task 1", "#Orders": "task 0", "#sheet 2": "task 2"}
    assert {end: read_sheet(f"{path}{end}").rows[0][1][0] for end in names} == names
    assert read_sheet(f"{path}#Orders").name == f"{path}#Orders"
    with pytest.raises(InputError, match=r"a.xlsx#no: has no sheet 'no'; it has \['Orders', 'Sheet 1', 'Sheet 2'\]"):
        read_sheet(f"{path}#no")


@pytest.mark.parametrize("merged", [False, True])
def test_a_cover_sheet_that_comes_first_is_named_and_so_are_the_others(tmp_path, merged):
    def change(book):
        book.active.title = "Cover"
        book.active.append(["Shop floor", "Monday"])
        if merged:
            book.active.merge_cells("A1:B1")
        book.worksheets[1].append(["task", "c_rob", "c_hum", "c_fail", "c_demo"])
        book.worksheets[1].append(["lid", 1, 2, 3, 4])
        book.worksheets[3].sheet_state = "hidden"

    path = saved(tmp_path / "day.xlsx", change, sheets=4)
    with pytest.raises(InputError) as caught:
        read_orders(read_sheet(path))
    text = "day.xlsx#Cover (its first sheet; there are also #Sheet 1, #Sheet 2), row 1"
    assert text in str(caught.value)
    assert read_orders(read_sheet(f"{path}#Sheet 1")).tasks == ("lid",)
    assert read_sheet(f"{path}#Sheet 1").name == f"{path}#Sheet 1"


def test_a_workbook_may_come_by_standard_input_and_under_any_name(tmp_path, monkeypatch):
    path = saved(tmp_path / "orders.csv", filled([("task", "c_rob"), ("lid", 10)]))
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(path.read_bytes())))
    assert read_sheet("-").rows == read_sheet(path).rows == ((2, ("lid", "10")),)


def test_a_formula_counts_as_the_value_that_is_stored(tmp_path):
    rows = [("task", "c_rob", "note"), ("lid", "=5+5", '=""')]
    path = saved(tmp_path / "a.xlsx", filled(rows))
    with pytest.raises(InputError, match=r"a.xlsx, row 2: the formula in B2 has no stored value; open the file in a"):
        read_sheet(path)
    rewritten(path, b"<f>5+5</f><v />", b"<f>5+5</f><v>10</v>")
    with pytest.raises(InputError, match="the formula in C2 has no stored value"):
        read_sheet(path)
    rewritten(path, b'<c r="C2"', b'<c r="C2" t="str"')
    assert read_sheet(path).rows == ((2, ("lid", "10", "")),)


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ("B1:C1", "row 1: cells of the header B1:C1 are merged; unmerge them"),
        ("A1:A2", "row 1: cells of the header A1:A2 are merged"),
        ("B2:B3", "row 2: cells B2:B3 are merged; unmerge them, so that each has a value of its own"),
    ],
)
def test_merged_cells_are_refused(tmp_path, cells, message):
    rows = [("task", "c_rob", "c_hum"), ("lid", 1, 2), ("box", 3, 4)]
    path = saved(tmp_path / "a.xlsx", lambda book: (filled(rows)(book), book.active.merge_cells(cells)))
    with pytest.raises(InputError, match=message):
        read_sheet(path)


def test_merged_cells_elsewhere_do_not_matter(tmp_path):
    rows = [("task", "c_rob"), ("lid", 1)]
    path = saved(tmp_path / "a.xlsx", lambda book: (filled(rows)(book), book.active.merge_cells("D1:E9")))
    assert read_sheet(path).rows == ((2, ("lid", "1")),)


def test_a_text_that_two_countries_read_differently_is_refused(tmp_path):
    sheet = read_sheet(saved(tmp_path / "a.xlsx", filled([("task", "c_rob"), ("lid", "1,234"), ("box", 1.234)])))
    assert number(sheet, 3, "c_rob", sheet.rows[1][1][1]) == 1.234
    with pytest.raises(InputError, match=r"'1,234' may be 1234 or 1.234"):
        number(sheet, 2, "c_rob", sheet.rows[0][1][1])


def test_what_is_no_workbook_is_refused(tmp_path):
    for part, message in (
        ("a.txt", "is a zip archive; give the table itself"),
        ("xl/workbook.bin", "is a binary workbook"),
        ("xl/workbook.xml", "cannot be read as an Excel workbook"),
    ):
        with zipfile.ZipFile(tmp_path / "a.xlsx", "w") as archive:
            archive.writestr(part, "text")
        with pytest.raises(InputError, match=rf"a.xlsx: {message}"):
            read_sheet(tmp_path / "a.xlsx")
    with zipfile.ZipFile(tmp_path / "a.ods", "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("content.xml", "")
    with pytest.raises(InputError, match=r"a.ods: is an OpenDocument file; save it as .xlsx or CSV"):
        read_sheet(tmp_path / "a.ods")
    whole = saved(tmp_path / "b.xlsx", filled([("a", "b"), (1, 2)])).read_bytes()
    (tmp_path / "b.xlsx").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"b.xlsx: is a damaged workbook or zip archive"):
        read_sheet(tmp_path / "b.xlsx")
    with pytest.raises(InputError, match=r"c.xlsx: is empty"):
        read_sheet(saved(tmp_path / "c.xlsx"))


def test_without_openpyxl_there_is_one_message(tmp_path, monkeypatch):
    path = saved(tmp_path / "a.xlsx", filled([("a", "b"), (1, 2)]))
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(
        InputError, match=r"a.xlsx: is an Excel workbook, and openpyxl, which reads them, is not installed"
    ):
        read_sheet(path)


def test_two_sheets_of_one_workbook_are_a_problem(tmp_path):
    orders = [
        ("Task", "C Rob", "C Hum", "C Fail", "C Demo", "Note"),
        ("lid", 1.5, 9, 9, 20, "new"),
        (7, "", "-", 9, 20),
    ]
    transfer = [(None, 7, "lid"), ("lid", 0.25, None), (7, None, "50 %")]
    path = saved(tmp_path / "day.xlsx", lambda book: (filled(orders)(book), filled(transfer, sheet=1)(book)), sheets=2)
    problem = read_problem(path, f"{path}#Sheet 1")
    assert problem.tasks == ("lid", "7")
    assert problem.c_rob.tolist() == [1.5, math.inf]
    assert [problem.transfer[0, 1], problem.transfer[1, 0]] == [0.25, 0.5]
