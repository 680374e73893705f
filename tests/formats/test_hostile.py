"""Files from strangers: no foreign error, nothing huge, nothing but text on the terminal."""

from __future__ import annotations

import pickle
import resource
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pytest

from mottrack.core import ConfigError, DataError, InputError, Objects
from mottrack.core.checks import as_array
from mottrack.core.limits import MAX_POINTS, MAX_ROWS
from mottrack.core.printed import printable, shown
from mottrack.experiment.overrides import parse_override
from mottrack.formats.columns import ColumnSpec, specs
from mottrack.formats.feather import read_feather_columns
from mottrack.formats.files import inside, read_text
from mottrack.formats.json_text import parse_json
from mottrack.formats.text_rows import Layout, read_text_columns
from mottrack.formats.text_table import Column, TextTable, to_csv, to_latex, to_markdown
from mottrack.formats.yaml_file import parse_scalar, parse_yaml


def test_messages_are_one_line_that_is_cut_and_escaped() -> None:
    error = DataError(Path("a\x1b[2J.txt"), "label\n", "x" * 5000 + "\x07", "text")
    text = str(error)
    assert text.isprintable()
    assert len(text) < 300
    assert "a\\x1b[2J.txt" in text
    assert str(pickle.loads(pickle.dumps(error))) == text  # noqa: S301 - made here
    assert printable("\ud800") == "\\ud800"
    assert "too long" in shown(10**5000)
    assert len(str(ConfigError("y" * 10_000))) <= 2000


def test_tables_hold_no_control_characters() -> None:
    table = TextTable("t", "T", (Column("name"),), (("car\x1b[31m",),))
    for text in (to_csv(table), to_markdown(table), to_latex(table)):
        assert "\x1b" not in text
        assert "x1b" in text


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1,1,10,10,40,80,,1,1.0", "line 1, confidence is empty"),
        ("1,1,10,1_0,40,80,1,1", "line 1, top is 1_0, expected a number in plain digits"),
        ("1,1,10,\uff11,40,80,1,1", "in plain digits"),
        ("1;1;10,5;10", "line 1 is 2 values"),
        ("1,1,10,10,40," + "9" * 5000, "line 1, height is 9+.*neither NaN nor infinity"),
        ("1,1,10,10,40,8\x1b0", "line 1 is a control character U\\+001B"),
    ],
)
def test_one_parser_of_text(line: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.write_text(line + "\n")
    columns = (
        *specs("frame", "id", "left", "top", "width", "height"),
        ColumnSpec("confidence", default=1.0),
        ColumnSpec("class", default=-1.0),
    )
    with pytest.raises(DataError, match=message):
        read_text_columns(path, columns, Layout(optional=2, loose=True))


def test_rows_of_one_file_have_one_length(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.write_text("1 2 3\n1 2\n")
    with pytest.raises(DataError, match="line 2 is 2 values, expected 3 as in line 1"):
        read_text_columns(path, specs("a", "b"), Layout(optional=1))


def test_encodings_are_told(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.write_bytes("1 2".encode("utf-16"))
    with pytest.raises(DataError, match="encoding is UTF-16 by its byte order mark"):
        read_text(path)
    path.write_bytes(b"1 2\n3 \xe4\n")
    with pytest.raises(DataError, match="line 2 is 0xe4 at byte 6, expected UTF-8"):
        read_text(path)
    path.write_bytes(b"\xef\xbb\xbf1\r\n2\r3\n")
    assert read_text(path) == "1\n2\n3\n"


@pytest.mark.parametrize("text", [b"[" * 100_000, b"[NaN, " + b"[" * 100_000, b'{"a": ' * 5000])
def test_deep_json(text: bytes) -> None:
    with pytest.raises(DataError, match=r"j\.json: JSON is"):
        parse_json(Path("j.json"), text)


@pytest.mark.parametrize("name", ["a" * 5000, "b/" * 3000, "x\0y", "\ud800", "../x", "/etc/passwd"])
def test_names_that_no_file_has(name: str, tmp_path: Path) -> None:
    with pytest.raises(DataError):
        inside(tmp_path, name)


def test_a_packed_feather_of_too_many_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "bomb.feather"
    rows = 30_000_000
    table = pa.table({"x": pa.array(np.zeros(rows, np.float64))})
    pa.feather.write_feather(table, path, compression="zstd", chunksize=rows)
    del table
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DataError, match="rows is 30000000, expected at most 20000000 rows"):
        read_feather_columns(path, specs("x"), MAX_ROWS)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 100_000
    monkeypatch.setenv(MAX_POINTS.name, "7")
    with pytest.raises(DataError, match="at most 7 rows"):
        read_feather_columns(path, specs("x"), MAX_POINTS)
    monkeypatch.setenv(MAX_POINTS.name, "many")
    with pytest.raises(ConfigError, match="MOTTRACK_MAX_POINTS is many, expected a positive"):
        _ = MAX_POINTS.value


def laughs(levels: int) -> str:
    """Ten values, and so often ten times as many: few aliases, gigabytes once written out."""
    first = "a0: &a0 [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]"
    more = [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 5)}]" for k in range(1, levels)]
    return "\n".join([first, *more])


@pytest.mark.parametrize(
    "text",
    [
        laughs(9),
        "a: &a [*a]",
        "a: !!bool maybe",
        "a: !!timestamp x",
        "a: !!int ''",
        "a: " + "9" * 5000,
        "a: !!python/object/apply:os.system [x]",
        "a: " + "[" * 1000,
    ],
)
def test_yaml_that_is_no_setting(text: str) -> None:
    with pytest.raises(DataError, match=r"e\.yaml: (content|line 1) is") as caught:
        parse_yaml(text, Path("e.yaml"))
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: " + "9" * 5000, "line 1 is 9+.*9, expected an integer of at most 4300 digits"),
        ("a: 1\nb: !!bool maybe", "line 2 is maybe, expected true or false"),
        ("a: !!float x", "line 1 is x, expected a number"),
    ],
)
def test_a_value_of_yaml_that_is_none_is_named(text: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        parse_yaml(text, Path("e.yaml"))


def test_dates_and_long_numbers_are_texts_of_settings() -> None:
    assert parse_yaml("name: 2024-99-99", Path("e"))["name"] == "2024-99-99"
    assert parse_override("name=2024-13-01") == ("name", ["2024-13-01"])
    assert parse_scalar("9" * 5000) == "9" * 5000
    assert parse_scalar("!!bool maybe") == "!!bool maybe"


@pytest.mark.parametrize(
    ("value", "dtype", "shape"),
    [
        (np.ma.masked_array([1.0, 2.0], [False, True]), np.float64, (None,)),
        (["True", "False"], np.bool_, (None,)),
        ([0.5, 1.0], np.bool_, (None,)),
        (["1.0", "2.0"], np.float64, (None,)),
        (np.array([1 + 2j]), np.float64, (None,)),
        ([[1.0], [1.0, 2.0]], np.float64, (None, 3)),
        ({"x": 1}, np.float64, (None, 3)),
    ],
)
def test_arrays_that_mean_something_else(value: object, dtype: object, shape: tuple) -> None:
    with pytest.raises(InputError):
        as_array("x", value, dtype, shape)


def test_a_frame_without_detections_is_an_empty_list() -> None:
    none = Objects(stamp_ns=0, centre_m=[], size_m=[], yaw_rad=[], label=[], score=[])
    assert none.centre_m.shape == (0, 3)
