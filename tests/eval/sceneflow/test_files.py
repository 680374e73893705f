"""The challenge's files, through the command line."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core.errors import DataError, InputError, ResultError
from mottrack.eval.sceneflow.figures import SceneSums
from mottrack.eval.sceneflow.files import (
    FileSet,
    pack_predictions,
    read_points,
    write_annotation,
    write_prediction,
)
from mottrack.eval.sceneflow.stored import empty_sums, load_sums, save_sums
from mottrack.eval.sceneflow.sums import frame_sums

from .test_figures import points_of

NAMES = ("log_a/1.feather", "log_a/2.feather", "log_b/7.feather")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for seed, name in enumerate(NAMES):
        points = points_of(0.5, seed, 40)
        write_annotation(tmp_path / "truth", name, points)
        write_prediction(tmp_path / "said", name, points)
    return tmp_path


def evaluated(folder: Path, predictions: Path) -> dict:
    command = ["eval", "sceneflow", "--truth", str(folder / "truth"), "--out", str(folder / "out")]
    done = CliRunner().invoke(app, [*command, "--predictions", str(predictions)])
    if done.exception:
        raise done.exception
    return json.loads((folder / "out/sceneflow.json").read_text())["methods"]


def test_a_zip_archive_gives_what_its_folder_gives(folder: Path) -> None:
    packed, again = folder / "said.zip", folder / "again.zip"
    pack_predictions(folder / "said", NAMES, packed)
    pack_predictions(folder / "said", NAMES[::-1], again)
    assert packed.read_bytes() == again.read_bytes()
    assert zipfile.ZipFile(packed).namelist() == sorted(NAMES)
    plain, zipped = evaluated(folder, folder / "said"), evaluated(folder, packed)
    assert plain["said"] == zipped["said.zip"]
    epe = plain["said"]["official"]["EPE/Foreground/Dynamic"]
    assert 0.2 < epe["value"] < 0.8
    assert epe["low"] < epe["value"] < epe["high"]


def test_files_keep_flow_to_half_precision(folder: Path) -> None:
    read = read_points(folder / "truth", FileSet(folder / "said"), NAMES[0])
    np.testing.assert_allclose(read.truth_m, points_of(0.5, 0, 40).truth_m, rtol=2**-11)


def test_what_is_wrong_with_files_is_named(folder: Path) -> None:
    write_prediction(folder / "said", NAMES[1], points_of(0.5, 0, 39))
    with pytest.raises(DataError, match=r"log_a/2.feather is 39 rows, expected 40, as annotated"):
        evaluated(folder, folder / "said")
    (folder / "said" / NAMES[0]).unlink()
    with pytest.raises(DataError, match=r"log_a/1.feather"):
        evaluated(folder, folder / "said")
    with pytest.raises(DataError, match="archive"):
        evaluated(folder, folder / "truth" / NAMES[0])
    done = CliRunner().invoke(app, ["eval", "sceneflow", "--out", str(folder / "out")])
    assert isinstance(done.exception, InputError)
    assert "a CONFIG, or --truth" in str(done.exception)


def test_stored_sums_give_the_same_figures(tmp_path: Path) -> None:
    parts = [frame_sums(points_of(0.5, seed, 40)) for seed in range(2)]
    for number, part in enumerate(parts):
        save_sums(tmp_path / f"{number}.npz", part)
    read = [load_sums(tmp_path / f"{number}.npz") for number in range(2)]
    plain, stored = SceneSums(tuple(parts)).values(), SceneSums(tuple(read)).values()
    assert plain.keys() == stored.keys()
    np.testing.assert_array_equal(list(plain.values()), list(stored.values()))
    beside_nothing = SceneSums((read[0], empty_sums())).values()
    alone = SceneSums((read[0],)).values()
    assert beside_nothing == pytest.approx(alone, nan_ok=True)
    data = bytearray((tmp_path / "0.npz").read_bytes())
    data[40] ^= 1
    (tmp_path / "0.npz").write_bytes(data)
    with pytest.raises(ResultError, match="checksum"):
        load_sums(tmp_path / "0.npz")
