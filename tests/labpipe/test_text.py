"""Codecs, sizes, lines and numbers of text files."""

import os
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from labpipe import text
from labpipe.errors import InputError, SourceError


def _file(tmp_path, data):
    path = tmp_path / "a.txt"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("codec", "expected"),
    [("ascii", "utf-8"), ("utf-8-sig", "utf-8-sig"), ("utf-16", "utf-16"), ("utf-32", "utf-32"), ("cp1252", "cp1252")],
)
def test_codec_is_settled_by_mark_then_utf8_then_declaration(tmp_path, codec, expected):
    content = "a\nb\n" if codec == "ascii" else "µm é\nb\n"
    source = text.survey(_file(tmp_path, content.encode(codec)), declared=("cp1252",))
    assert source.encoding == expected
    assert list(source.lines()) == content.splitlines()


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.text(alphabet="ab\r\n", max_size=40), st.integers(1, 7))
def test_lines_do_not_depend_on_where_pieces_are_cut(tmp_path_factory, content, piece):
    path = tmp_path_factory.mktemp("pieces") / "a.txt"
    path.write_bytes(("x" + content).encode())
    with pytest.MonkeyPatch.context() as change:
        change.setattr(text, "_PIECE", piece)
        source = text.survey(path)
    lines = list(source.lines())
    assert source.n_lines == len(lines)
    assert source.is_ended == content.endswith(("\r", "\n"))
    assert "\n".join(lines) == ("x" + content).replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n")


@pytest.mark.parametrize(("character", "codec"), [("\0", "ascii"), ("\x0c", "ascii"), ("\x7f", "utf-16")])
def test_control_characters_are_refused(tmp_path, character, codec):
    with pytest.raises(SourceError, match="control character") as caught:
        text.survey(_file(tmp_path, f"ab\n1{character}2\n".encode(codec)))
    assert (caught.value.line, caught.value.column) == (2, 2)


def test_line_of_a_billion_characters_is_refused_from_its_first_pieces(tmp_path):
    path = _file(tmp_path, b"head\n" + b"1" * (3 << 20))
    os.truncate(path, 10**9)
    tracemalloc.start()
    with pytest.raises(SourceError, match="longer than 1048576") as caught:
        text.survey(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert caught.value.line == 2
    assert peak < 16 << 20


def test_a_file_that_is_empty_too_large_cut_within_a_character_or_grows_is_refused(tmp_path):
    with pytest.raises(SourceError, match="empty"):
        text.survey(_file(tmp_path, b""))
    path = _file(tmp_path, b"a\n")
    os.truncate(path, (1 << 30) + 1)
    with pytest.raises(SourceError, match="at most 1073741824"):
        text.survey(path)
    path = _file(tmp_path, "time,value\n1,2\n".encode("utf-16")[:-1])
    with pytest.raises(SourceError, match="ends within a character of UTF-16: the file was cut off"):
        text.survey(path)
    path = _file(tmp_path, b"a\nb\n")
    source = text.survey(path)
    path.write_bytes(b"a\nb\nc\n")
    with pytest.raises(SourceError, match="changed while it was read"):
        list(source.lines())


@pytest.mark.parametrize(
    ("row", "column", "message"),
    [
        ("1,2x,3", 3, "'2x'"),
        ("1,,3", 3, "''"),
        ("1,2", 4, "2 cells, expected 3"),
        ("1,nan,3", 3, "'nan'"),
        ("1,1e999,3", 3, "'1e999'"),
        ("1,1_0,3", 3, "'1_0'"),
    ],
)
def test_wrong_cell_is_named_by_line_and_column(row, column, message):
    lines = ["1,2,3", row, "4,5,6"]
    with pytest.raises(SourceError, match=message) as caught:
        text.parse_rows(lines, 3, ",", path="a.txt", first_line=10)
    assert (caught.value.line, caught.value.column) == (11, column)
    assert str(caught.value).startswith("a.txt:11:")


COMMA = text.Separators(",", "")
GROUPED = text.Separators(",", ".")


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (["1.5", "2"], text.DOT),
        (["1.234"], text.DOT),
        (["1.234.567", "1,5"], GROUPED),
        (["1,234.5"], text.Separators(".", ",")),
        (["alarm", "-------", "1,5"], COMMA),
    ],
)
def test_decimal_sign_is_decided_by_evidence(cells, expected):
    assert text.separators(cells) == expected


@pytest.mark.parametrize("cells", [["1,234"], ["12,345", "6,789"], ["1.5", "2,5"]])
def test_ambiguous_decimal_sign_is_refused(cells):
    with pytest.raises(InputError, match="decimal="):
        text.separators(cells)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.floats(-1e9, 1e9), st.integers(0, 6))
def test_a_number_reads_the_same_with_dot_comma_or_thousands(value, decimals):
    dotted = f"{value:.{decimals}f}"
    grouped = f"{value:,.{decimals}f}".replace(",", "_").replace(".", ",").replace("_", ".")
    assert text.plain_number(dotted) == float(dotted)
    assert text.plain_number(dotted.replace(".", ","), COMMA) == float(dotted)
    assert text.plain_number(grouped, GROUPED) == float(dotted)
    rows = text.parse_rows([f"1;{grouped}"], 2, ";", path="a", first_line=1, signs=GROUPED)
    np.testing.assert_array_equal(rows, [[1, float(dotted)]])
    rows = text.parse_rows(["1;2,5"], 2, ";", path="a", first_line=1, signs=COMMA)
    np.testing.assert_array_equal(rows, [[1, 2.5]])
