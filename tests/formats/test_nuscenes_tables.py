"""Tables read a block at a time, and the official splits."""

import json
from pathlib import Path

import pytest

from mottrack.core.errors import ConfigError, DataError
from mottrack.formats.columns import ColumnSpec
from mottrack.formats.nuscenes_splits import (
    SPLITS,
    best_split,
    resolve_split,
    split_scenes,
    splits_of,
)
from mottrack.formats.nuscenes_tables import (
    TOKEN,
    NuScenesTables,
)
from mottrack.formats.table_stream import RecordFilter, stream_table


@pytest.mark.parametrize("indent", [None, 0, 2])
@pytest.mark.parametrize("block", [300, 1000, 10**6])
def test_blocks_of_any_size_give_the_same_records(
    tmp_path: Path, indent: int | None, block: int
) -> None:
    rows = [{"token": str(k), "place": [k, 1.5], "text": 'a },{ "b" ]'} for k in range(300)]
    path = tmp_path / "t.json"
    path.write_text(json.dumps(rows, indent=indent))
    assert list(stream_table(path, block)) == rows
    path.write_text("[]")
    assert list(stream_table(path, block)) == []


def test_only_the_wanted_records_are_kept(tmp_path: Path) -> None:
    (tmp_path / "v1.0").mkdir()
    path = tmp_path / "v1.0/sample.json"
    path.write_text('[{"token": "a", "x": 1}, {"token": "b", "x": 2}]')
    tables = NuScenesTables(tmp_path, "v1.0")
    assert [row["x"] for row in tables.rows("sample")] == [1, 2]
    (row,) = tables.rows("sample", RecordFilter({"token": ["b", "c"]}))
    assert row["x"] == 2
    columns = tables.columns("sample", (TOKEN, ColumnSpec("x", int)))
    assert columns["token"].tolist() == [b"a", b"b"]
    assert columns["x"].tolist() == [1, 2]


def test_faults_name_the_table_and_the_record(tmp_path: Path) -> None:
    (tmp_path / "v1.0").mkdir()
    path = tmp_path / "v1.0/sample.json"
    tables = NuScenesTables(tmp_path, "v1.0")
    with pytest.raises(DataError, match=r"version is v2.*here: v1\.0"):
        NuScenesTables(tmp_path, "v2").path("sample")
    with pytest.raises(DataError, match=r"scene\.json"):
        tables.path("scene")
    for text in ('{"token": 1}', "[1, 2]", '[{"token": 1}', ""):
        path.write_text(text)
        with pytest.raises(DataError, match=r"sample\.json"):
            list(tables.rows("sample"))
    path.write_text('[{"token": "a", "x": 1}, {"token": "b", "x": "1"}]')
    with pytest.raises(DataError, match=r"x of record b is 1, expected a finite integer"):
        tables.columns("sample", (TOKEN, ColumnSpec("x", int)))


def test_splits_by_name_by_file_and_back(tmp_path: Path) -> None:
    sizes = {name: len(split_scenes(name)) for name in SPLITS}
    assert sizes == {
        "train": 700,
        "train_detect": 350,
        "train_track": 350,
        "val": 150,
        "test": 150,
        "mini_train": 8,
        "mini_val": 2,
    }
    assert best_split(["scene-0103"]) == "mini_val"
    assert splits_of(["scene-0003", "scene-0001"]) == {"train": 1, "train_detect": 1, "val": 1}
    path = tmp_path / "mine.txt"
    path.write_text("# mine\nscene-0001\n\nscene-0002\n")
    assert resolve_split(str(path)) == ("scene-0001", "scene-0002")
    path.write_text("\n")
    with pytest.raises(DataError, match="scene names"):
        resolve_split(str(path))
    with pytest.raises(ConfigError, match=r"unknown split 'mini-val' .did you mean 'mini_val'"):
        resolve_split("mini-val")
