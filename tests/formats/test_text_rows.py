"""Texts of plain numbers, read all at once, are what the reader of lines gives, or left to it."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mottrack.core.errors import DataError
from mottrack.formats import text_rows
from mottrack.formats.columns import ColumnSpec, specs
from mottrack.formats.text_rows import Layout, read_text_columns

COLUMNS = (*specs("a", "b"), ColumnSpec("c", default=7.0))
LAYOUT = Layout(optional=1, loose=True)
Number = st.floats(allow_nan=False, allow_infinity=False)


def plain(text: str) -> np.ndarray | None:
    return text_rows._plain_table(text, COLUMNS, LAYOUT)


@given(st.lists(st.lists(Number, min_size=3, max_size=3), min_size=1, max_size=5))
def test_plain_numbers_are_read_to_the_last_bit(rows: list[list[float]]) -> None:
    text = "\n".join(",".join(map(repr, row)) for row in rows) + "\n"
    found = plain(text)
    assert found is not None
    assert found.tolist() == rows


@given(st.text(alphabet="12.+-eE, \n", max_size=24))
def test_what_is_taken_at_once_is_what_the_lines_hold(text: str) -> None:
    found = plain(text)
    if found is None:
        return
    lines = text.removesuffix("\n").split("\n")
    assert found.tolist() == [[float(value) for value in line.split(",")] for line in lines]


@pytest.mark.parametrize(
    "text",
    [
        "", "\n", "1,2\n\n3,4", "1,,3", "1,2,\n", ",1,2", "1,2\n1,2,3", "1", "1,2,3,4,5", "1,nan",
        "1,1e999", "1,0x1", "1,1_0", "1 2,3", "1-2,3", "1.2.3,4", "1;2", "1,2\r\n", "1,\u0661",
    ],
)  # fmt: skip
def test_everything_else_is_left_to_the_reader_of_lines(text: str) -> None:
    assert plain(text) is None


def test_both_give_the_same_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "t.txt"
    path.write_text("1, 2.5\n-3e-2,4\n")
    fast = read_text_columns(path, COLUMNS, LAYOUT)
    monkeypatch.setattr(text_rows, "_plain_table", lambda *_: None)
    slow = read_text_columns(path, COLUMNS, LAYOUT)
    for name in "abc":
        np.testing.assert_array_equal(fast[name], slow[name])
    np.testing.assert_array_equal(fast.row, slow.row)
    path.write_text("1,2\n3,x\n")
    with pytest.raises(DataError, match="line 2, b"):
        read_text_columns(path, COLUMNS, LAYOUT)
