"""Large tables read into columns are what the reader of single records gives, or left to it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mottrack.core.errors import DataError
from mottrack.formats import table_columns
from mottrack.formats.columns import ColumnSpec
from mottrack.formats.nuscenes_tables import NuScenesTables
from mottrack.formats.table_columns import large_columns
from mottrack.formats.table_stream import RecordCount, RecordFilter

SPECS = (
    ColumnSpec("token", str),
    ColumnSpec("sample", str),
    ColumnSpec("place", width=3),
    ColumnSpec("points", int),
)


@pytest.fixture(autouse=True)
def _small_files_and_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_columns, "LARGE_BYTES", 0)
    monkeypatch.setattr(table_columns, "_BLOCK_BYTES", 700)


def records(count: int = 60) -> list[dict[str, Any]]:
    return [
        {"token": f"t{k}", "sample": f"s{k % 7}", "place": [k / 3, 1, -2e-5], "points": k, "x": []}
        for k in range(count)
    ]


def wanted() -> RecordFilter:
    return RecordFilter({"sample": ["s1", "s5"]}, {"sample": [f"s{k}" for k in range(7)]})


@pytest.mark.parametrize("among", [RecordFilter, wanted])
@pytest.mark.parametrize("layout", [{}, {"indent": 0}, {"indent": 2}, {"separators": (",", ":")}])
def test_columns_are_those_of_the_reader_of_records(
    tmp_path: Path, layout: dict[str, Any], among: Any
) -> None:
    (tmp_path / "v1.0").mkdir()
    path = tmp_path / "v1.0/t.json"
    path.write_text(json.dumps(records(), **layout))
    counts = RecordCount(), RecordCount()
    filters = [RecordFilter(among().wanted, among().known, count) for count in counts]
    found = large_columns(path, SPECS, filters[0])
    rows = NuScenesTables(tmp_path, "v1.0")._arrays("t", SPECS, filters[1])
    assert found is not None
    for name, column in rows.items():
        assert found[name].dtype.kind == column.dtype.kind
        np.testing.assert_array_equal(found[name], column)
    assert counts[0].records == counts[1].records == 60


@pytest.mark.parametrize(
    "change",
    [
        {"token": None}, {"token": 1}, {"token": "\u00e9"}, {"token": "a\nb"}, {"token": 'a},{"'},
        {"sample": "s9"}, {"place": [1, 2]}, {"place": [1, 2, None]}, {"place": 1},
        {"place": [1, 2, float("nan")]}, {"points": 1.5}, {"points": 2**70}, {"points": True},
    ],
)  # fmt: skip
def test_what_is_unclear_is_left_to_the_reader_of_records(
    tmp_path: Path, change: dict[str, Any]
) -> None:
    rows = records()
    rows[33] |= change  # one that is wanted
    path = tmp_path / "t.json"
    path.write_text(json.dumps(rows))
    assert large_columns(path, SPECS, wanted()) is None


@pytest.mark.parametrize(
    "text", ["[{]", "{}", "", '[{"token": "a"}] x', '[{"token": "a"} {"b": 1}]']
)
def test_damaged_text_is_refused_as_before(tmp_path: Path, text: str) -> None:
    (tmp_path / "v1.0").mkdir()
    (tmp_path / "v1.0/t.json").write_text(text)
    with pytest.raises(DataError, match=r"t\.json"):
        NuScenesTables(tmp_path, "v1.0").columns("t", SPECS[:1])
