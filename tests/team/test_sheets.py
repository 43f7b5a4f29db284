import codecs
import csv
import io
import os
import sys

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from p2l.errors import InputError
from p2l.team.sheets import Sheet, read_sheet

SAME = Sheet("orders", ("task", "c_rob"), ((2, ("lid", "10")), (3, ("box", "20"))), False)
PLAIN = "task,c_rob\nlid,10\nbox,20\n"


def sheet_of(tmp_path, content, name="orders"):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_sheet(path)


def content(sheet):
    return sheet.header, sheet.rows


@pytest.mark.parametrize(
    "text",
    [
        PLAIN,
        PLAIN.encode("utf-8-sig"),
        PLAIN.encode("utf-16"),
        codecs.BOM_UTF16_BE + PLAIN.encode("utf-16-be"),
        PLAIN.encode("utf-16-le"),
        PLAIN.encode("utf-16-be"),
        PLAIN.replace(",", ";"),
        PLAIN.replace(",", "\t"),
        PLAIN.replace(",", "|"),
        PLAIN.replace("\n", "\r"),
        PLAIN.replace("\n", "\r\n"),
        PLAIN.removesuffix("\n"),
        PLAIN + ",\n , \n\n",
        PLAIN + "   \n",
        PLAIN.replace("\n", ",,\n"),
        PLAIN.replace("\n", ", ,\n").replace(",", ";"),
        "".join(f",{line}\n" for line in PLAIN.splitlines()),
        "".join(f"{line.replace(',', ',,')}\n" for line in PLAIN.splitlines()),
        "task , c_rob\n lid,\t10\nbox\u00a0,\u202f20\n",
        '"task","c_rob"\n"lid","10"\n"box","20"\n',
        'task, "c_rob"\nlid, "10"\n"box", 20',
        "sep=,\n" + PLAIN,
        '"sep=;"\r\n' + PLAIN.replace(",", ";"),
        ("SEP=;\r\n" + PLAIN.replace(",", ";")).encode("utf-16"),
        "sep=\t\n" + PLAIN.replace(",", "\t"),
        "sep=;;\n" + PLAIN.replace(",", ";"),
    ],
)
def test_every_spelling_of_a_table_gives_the_same_sheet(tmp_path, text):
    assert content(sheet_of(tmp_path, text)) == content(SAME)


def test_lines_are_those_of_a_spreadsheet(tmp_path):
    sheet = sheet_of(tmp_path, '\n\ntask,note\n\nlid,"two\nlines"\n,\nbox,"one"\n')
    assert sheet.header_line == 3
    assert sheet.rows == ((5, ("lid", "two\nlines")), (7, ("box", "one")))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
def test_letters_arrive_whatever_the_encoding(tmp_path, encoding):
    sheet = sheet_of(tmp_path, "Größe;Kosten €\nschön;’3’\n".encode(encoding))
    assert content(sheet) == (("Größe", "Kosten €"), ((2, ("schön", "’3’")),))


@pytest.mark.parametrize("text", ["プラグ,費用\n蓋,10\n", "Ã¤,b\nc,d\n", "é,—\nñ,😀\n"])
def test_valid_utf8_is_never_taken_for_anything_else(tmp_path, text):
    sheet = sheet_of(tmp_path, text)
    assert [sheet.header, *(cells for _, cells in sheet.rows)] == [tuple(each.split(",")) for each in text.split()]


@pytest.mark.parametrize(
    ("text", "delimiter"),
    [
        ("task;c_rob\nlid, red;1,5\nbox;2,5\n", ";"),
        (";lid, red;box\nlid, red;1;0,5\nbox;0,5;1\n", ";"),
        (",a;b,c\na;b,1,2\nc,3,4\n", ","),
        ("task\tnote\nlid\ta, b; c | d\n", "\t"),
        ('task;"a,b"\nlid;"1,2"\n', ";"),
        ('"a;b",c\n"d;e",f\n', ","),
        ("sep=;\na,b;c\nd,e;f\n", ";"),
    ],
)
def test_the_delimiter_is_the_one_that_fits_every_row(tmp_path, text, delimiter):
    plain = text.removeprefix("sep=;\n")
    expected = [tuple(each.strip('"') for each in line.split(delimiter)) for line in plain.splitlines()]
    sheet = sheet_of(tmp_path, text)
    assert [sheet.header, *(cells for _, cells in sheet.rows)] == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ": is empty"),
        (" \n\n", ": is empty"),
        (",,\n,,\n", ": is empty"),
        ("sep=;\n", ": is empty"),
        ("task\nlid\n", ", row 1: the header has one cell only"),
        ("\ntask,\nlid,1\n", ", row 2: the header has one cell only"),
        ("Tasks of today\ntask,c_rob\nlid,1\n", ", row 1: the header has one cell only; name the columns"),
        ("a,b\n1,2,3\n", ", row 2: has 3 cells; the header has 2"),
        ("a;b\n1;2\n\n1\n", ", row 4: has 1 cells; the header has 2"),
        ("a,b\n1;2\n", ", row 2: has 1 cells; the header has 2"),
        ("a,b\n1,2,\n", ", row 2: has 3 cells; the header has 2"),
        ("a,b,c\n1,2\n", ", row 2: has 2 cells; the header has 3"),
        ("a,b, a\n1,2,3\n", ", row 1, column 'a': column appears twice"),
        ("a,b\n\0,2\n", ", row 2, column 'a': '\\x00' holds a NUL character; remove it"),
        ("a,b\n1,2\x1f\n", ", row 2, column 'b': '2\\x1f' holds a control character; remove it"),
        ("a,b\x85\n1,2\n", ", row 1: 'b\\x85' holds a control character; remove it"),
        ("a,b\n\x1a", ", row 2, column 'a': '\\x1a' holds a control character"),
        ('a,b\n1,"2\n', ", row 2: a quote is not closed, or there is text behind it"),
        ('a,b\n1,2\n"1"x,2\n', ", row 3: a quote is not closed, or there is text behind it"),
        ('"a,b\n1,2\n', ", row 1: a quote is not closed"),
        ("a,b;c\nd,e;f\n", ": its cells can be parted at commas or semicolons; write sep=, as the first line"),
        ("sep=:\na:b\n", ", row 1: 'sep=:' is not allowed; separate the cells by commas, semicolons, tabs or"),
        ("sep=;\na,b\n1,2\n", ", row 1: the header has one cell only"),
        (b"a,b\n\x81,2\n", ": is text of no known encoding"),
        ("a,b\n1,2\n".encode("utf-16")[:-1], ": is text of no known encoding"),
        (b"%PDF-1.7\n", ": is a PDF"),
        (b"\x1f\x8b\x08\x00", ": is a gzip archive"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", ": is of an old Office (.xls); save it as .xlsx or CSV"),
        (b"\xd0\xcf\x11\xe0" + "EncryptedPackage".encode("utf-16-le"), ": is protected by a password; save it without"),
        ("<!DOCTYPE html><table>", ": is HTML or XML"),
        (b"PK\x05\x06" + bytes(18), ": is an empty zip archive"),
        (b"PK\x03\x04 torn", ": is a damaged workbook or zip archive"),
    ],
)
def test_what_is_no_table_gets_one_message(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        sheet_of(tmp_path, text)
    assert f"orders{message}" in str(caught.value)
    assert str(caught.value).isprintable()


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(InputError, match=r"absent.csv: no such file; check the path"):
        read_sheet(tmp_path / "absent.csv")
    with pytest.raises(InputError, match=r"is a directory; give the file itself"):
        read_sheet(str(tmp_path))
    (tmp_path / "no.xlsx").write_text(PLAIN)
    with pytest.raises(InputError, match=r"no.xlsx#tasks: is no .xlsx workbook, so it has no sheets"):
        read_sheet(f"{tmp_path}/no.xlsx#tasks")
    (tmp_path / "a#b.csv").write_text(PLAIN)
    assert content(read_sheet(tmp_path / "a#b.csv")) == content(SAME)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
def test_standard_input_is_read_as_bytes(monkeypatch, encoding):
    data = "task;Größe\nlid;1,5\n".encode(encoding)
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data), encoding="ascii"))
    sheet = read_sheet("-")
    assert (sheet.name, content(sheet)) == ("standard input", (("task", "Größe"), ((2, ("lid", "1,5")),)))
    with pytest.raises(InputError, match="standard input: is empty"):
        read_sheet("-")


def test_a_pipe_is_read(tmp_path):
    reading, writing = os.pipe()
    os.write(writing, PLAIN.encode())
    os.close(writing)
    assert content(read_sheet(f"/dev/fd/{reading}")) == content(SAME)
    os.close(reading)


def test_known_columns_are_found_however_they_are_spelt():
    sheet = Sheet("orders.csv", ("Note", "TASK", "c-Rob", "C  hum", "c_fail", "", "C – Demo"), (), False)
    known = ("task", "c_rob", "c_hum", "c_fail", "c_demo", "pretrained")
    assert sheet.columns(known) == {"task": 1, "c_rob": 2, "c_hum": 3, "c_fail": 4, "c_demo": 6}
    assert sheet.extra(known) == ("Note",)
    twice = Sheet("orders.csv", ("task", "C Rob", "c_rob", "Note", "note"), (), False, header_line=4)
    assert twice.columns(("task", "c_hum")) == {"task": 0}
    with pytest.raises(InputError, match=r"orders.csv, row 4, column 'c_rob': means 'c_rob', and so does 'C Rob'"):
        twice.columns(known)


LETTERS = st.characters(
    exclude_categories=("Cs", "Cc"), exclude_characters="\u200b\ufeff\u2028\u2029", include_characters="\n"
)
CELLS = st.text(LETTERS, max_size=8).map(str.strip)
ENDS = st.sampled_from(["\n", "\r\n", "\r"])
ENCODINGS = st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-be-bom"])


@given(data=st.data(), mark=st.sampled_from(",;\t|"), end=ENDS, encoding=ENCODINGS, sep=st.booleans())
def test_any_table_that_is_written_is_the_one_that_is_read(tmp_path_factory, data, mark, end, encoding, sep):
    width = data.draw(st.integers(2, 5))
    header = data.draw(st.lists(CELLS.filter(bool), min_size=width, max_size=width, unique=True))
    rows = data.draw(st.lists(st.lists(CELLS, min_size=width, max_size=width), max_size=5))
    sep = sep or any(other in "".join(map("".join, [header, *rows])) for other in ",;\t|")
    assume(sep or "=" not in header[0])
    text = io.StringIO(newline="")
    has_breaks = "\n" in "".join(map("".join, [header, *rows]))  # which csv leaves bare before other line ends
    quoting = csv.QUOTE_ALL if has_breaks else data.draw(st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]))
    csv.writer(text, delimiter=mark, lineterminator=end, quoting=quoting).writerows([header, *rows])
    whole = f"sep={mark}{end}" * sep + text.getvalue()
    assume(not whole.lstrip().startswith(("<", "%PDF", "PAR1", "{\\rtf")))
    codec = {"utf-16-be-bom": "utf-16-be"}.get(encoding, encoding)
    path = tmp_path_factory.getbasetemp() / "table.csv"
    path.write_bytes(codecs.BOM_UTF16_BE * (codec != encoding) + whole.encode(codec))
    sheet = read_sheet(path)
    expected = [(line, tuple(cells)) for line, cells in enumerate(rows, 2) if any(cells)]
    assert content(sheet) == (tuple(header), tuple(expected))


@given(st.binary(max_size=60))
def test_any_bytes_give_a_sheet_or_one_message(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "table.csv"
    path.write_bytes(data)
    problem, rows = "", []
    try:
        sheet = read_sheet(path)
        rows = [sheet.header, *(cells for _, cells in sheet.rows)]
    except InputError as error:
        problem = str(error)
    assert bool(problem) != bool(rows)
    assert problem.isprintable()
    assert all(len(cells) == len(rows[0]) > 1 for cells in rows)
