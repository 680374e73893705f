"""Tracks written for other tools, tracks of other tools made runs, and stored runs compared."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from mottrack.cli import app
from mottrack.core import MottrackError
from mottrack.core.tables import TrackTable
from mottrack.datasets.kitti.boxes import CameraBoxes, image_boxes
from mottrack.datasets.scene_frames import key_frames
from mottrack.eval.kitti.files import Folders, evaluate_folders
from mottrack.eval.kitti.matching import KittiRules
from mottrack.experiment.experiment import load_experiments
from mottrack.runs.run_folder import RunFolder
from mottrack.runs.tracks_in import READERS, Import, import_tracks
from mottrack.runs.tracks_out import WRITERS, StoredTracks, write_tracks
from tests.datasets.makers import maker
from tests.runs.perfect import perfect

ROUNDED_M = 2e-6
"""KITTI's and MOTChallenge's text files are written with six decimals."""
# format, kind of the data set, file or folder, format of the import
TRIPS = (
    ("nuscenes", "nuscenes", "tracks.json", "nuscenes"),
    ("kitti", "kitti", "tracks", "kitti"),
    ("kitti", "folder", "tracks", "kitti"),
    ("argoverse2", "argoverse2", "tracks", "argoverse2"),
    ("csv", "folder", "tracks.csv", "table"),
    ("csv", "kitti", "tracks.csv", "table"),
    ("parquet", "nuscenes", "tracks.parquet", "table"),
)


def mottrack(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=True)


@pytest.fixture(scope="module")
def root_of(tmp_path_factory):
    roots: dict[str, Path] = {}

    def root(kind: str) -> Path:
        if kind not in roots:
            roots[kind] = tmp_path_factory.mktemp(kind)
            maker(kind).write(roots[kind])
        return roots[kind]

    return root


def dataset_of(kind: str, root: Path) -> dict[str, object]:
    return {"kind": kind, "root": str(root)} | dict(maker(kind).settings)


def stored_run(folder: Path, settings: dict[str, object]) -> RunFolder:
    """Store the run of a tracker that returns the truth."""
    text = f"dataset={json.dumps(settings)}"
    experiment = load_experiments("demo", [text, "flow=zero", "tracker=kalman"])[0]
    run, dataset = RunFolder(folder), experiment.dataset.make()
    run.reserve(experiment)
    for name in dataset.scene_names:
        scene = dataset.scene(name)
        run.store_result(perfect(name, list(key_frames(scene)), scene.classes), [])
    return run


def rows(tracks: TrackTable):
    """Return the rows by frame and place: identities may be numbered anew."""
    return tracks.select(np.lexsort((*tracks.centre_m.T, tracks.frame)))


def test_every_format_makes_a_round_trip_here():
    """Image boxes have a test of their own below; mcap files are read by other tools."""
    assert {trip[0] for trip in TRIPS} == WRITERS.keys() - {"mot", "mcap"}
    assert {trip[3] for trip in TRIPS} == READERS.keys() - {"mot"}


@pytest.mark.parametrize(("format_name", "kind", "name", "back"), TRIPS)
def test_tracks_come_back_as_they_were_written(root_of, tmp_path, format_name, kind, name, back):
    settings = dataset_of(kind, root_of(kind))
    run = stored_run(tmp_path / "run", settings)
    path = tmp_path / name
    written = write_tracks(StoredTracks.of(run.path), format_name, path)
    imported = import_tracks(Import((path,), back, settings), tmp_path / "back")
    assert imported.absent == ()
    boxes = 0
    for scene in run.scenes:
        ours, theirs = rows(run.load(scene).tracks), rows(imported.run.folder.load(scene).tracks)
        boxes += len(theirs)
        if format_name == "kitti" and kind == "folder":  # labels around, but one camera
            assert 0 < len(theirs) < len(ours)
            near = [np.abs(ours.centre_m - c).max(axis=1).min() for c in theirs.centre_m]
            assert max(near) < ROUNDED_M
            continue
        assert np.array_equal(ours.frame, theirs.frame)
        assert np.array_equal(ours.label, theirs.label)
        np.testing.assert_allclose(theirs.centre_m, ours.centre_m, atol=ROUNDED_M)
        np.testing.assert_allclose(theirs.size_m, ours.size_m, atol=ROUNDED_M)
        np.testing.assert_allclose(theirs.score, ours.score, atol=ROUNDED_M)
        turned = np.angle(np.exp(1j * (theirs.yaw_rad - ours.yaw_rad)))
        np.testing.assert_allclose(turned, 0.0, atol=ROUNDED_M)
        pairs = set(zip(ours.id.tolist(), theirs.id.tolist(), strict=True))
        assert len(pairs) == len(np.unique(ours.id)) == len(np.unique(theirs.id))
        known = format_name != "kitti"  # the one format without velocities
        assert np.isfinite(theirs.velocity_mps).all() == known
        if known:
            np.testing.assert_allclose(theirs.velocity_mps, ours.velocity_mps, atol=ROUNDED_M)
    assert boxes == written.boxes


def test_kitti_results_are_scored_without_a_line_of_the_users_own(root_of, tmp_path):
    """Near the truth in every frame: no switch, and every car that counts is found."""
    settings = dataset_of("kitti", root_of("kitti"))
    run = stored_run(tmp_path / "run", settings)
    out = tmp_path / "kitti"
    assert mottrack("tracks", run.path, "--format", "kitti", "--out", out).exit_code == 0
    labels = root_of("kitti") / "training/label_02"
    scored = evaluate_folders(Folders(labels, out, run.scenes), KittiRules("car")).metrics
    assert (scored.as_dict()["fn"], scored.as_dict()["ids"]) == (0, 0)
    line = (out / f"{run.scenes[0]}.txt").read_text().splitlines()[0].split()
    assert len(line) == 18
    size, place, turn = (np.array(line[a:b], float) for a, b in ((10, 13), (13, 16), (16, 17)))
    image = image_boxes(CameraBoxes(place[None], size[None], turn))[0]
    assert list(map(float, line[6:10])) == pytest.approx(image, abs=25)  # images differ in size


def test_av2s_evaluator_gets_plain_frames_of_its_categories(root_of, tmp_path):
    run = stored_run(tmp_path / "run", dataset_of("argoverse2", root_of("argoverse2")))
    write_tracks(StoredTracks.of(run.path), "argoverse2", tmp_path / "out")
    sides = [
        pickle.loads((tmp_path / f"out/{name}.pkl").read_bytes())  # noqa: S301 - made above
        for name in ("predictions", "ground_truth")
    ]
    for predicted, labelled in zip(*(s[run.scenes[0]] for s in sides), strict=True):
        assert predicted["timestamp_ns"] == labelled["timestamp_ns"]
        assert "score" in predicted
        for frame in (predicted, labelled):
            n = len(frame["track_id"])
            shapes = {k: v.shape for k, v in frame.items() if isinstance(v, np.ndarray)}
            assert shapes["translation_m"] == shapes["velocity_m_per_s"] == (n, 3)


def test_a_log_has_the_tracks_of_every_frame(root_of, tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="needs the extra: pip install mottrack[ros]")
    run = stored_run(tmp_path / "run", dataset_of("folder", root_of("folder")))
    done = mottrack("tracks", run.path, "--format", "mcap", "--out", tmp_path / "logs")
    assert done.exit_code == 0, done.output
    for scene in run.scenes:
        with (tmp_path / f"logs/{scene}.mcap").open("rb") as file:
            messages = list(reader.make_reader(file).iter_messages(topics=["/tracks/boxes"]))
        stamps = [message.log_time for _, _, message in messages]
        assert stamps == run.load(scene).frames.stamp_ns.tolist()


def test_tracks_of_several_files_are_other_tracks(root_of, tmp_path):
    """AB3DMOT writes a folder for each class, and numbers each from 0."""
    settings = dataset_of("kitti", root_of("kitti"))
    run = stored_run(tmp_path / "run", settings)
    whole = tmp_path / "whole"
    write_tracks(StoredTracks.of(run.path), "kitti", whole)
    parts = []
    for kind in ("Car", "Pedestrian", "Cyclist"):
        parts.append(tmp_path / kind)
        (parts[-1] / "data_0").mkdir(parents=True)
        for path in whole.glob("*.txt"):
            lines = [line.split() for line in path.read_text().splitlines()]
            own = [line for line in lines if line[2] == kind]
            numbers = {line[1]: str(i) for i, line in enumerate(own)}
            text = "".join(f"{' '.join([w[0], numbers[w[1]], *w[2:]])}\n" for w in own)
            (parts[-1] / "data_0" / path.name).write_text(text)
    imported = import_tracks(Import(tuple(parts), "kitti", settings), tmp_path / "back")
    for scene in run.scenes:
        ours, theirs = rows(run.load(scene).tracks), rows(imported.run.folder.load(scene).tracks)
        assert np.array_equal(ours.label, theirs.label)
        pairs = set(zip(ours.id.tolist(), theirs.id.tolist(), strict=True))
        assert len(pairs) == len(np.unique(ours.id)) == len(np.unique(theirs.id))


def test_an_imported_run_is_reported_and_compared(root_of, tmp_path):
    """Paired with itself under another name, in another folder: no difference, no velocity."""
    root = root_of("kitti")
    run = stored_run(tmp_path / "ours", dataset_of("kitti", root))
    out = tmp_path / "theirs.txt"
    mottrack("tracks", run.path, "--format", "kitti", "--out", out)
    done = mottrack(
        "import", root, "--format", "kitti", "--tracks", out, "--out", tmp_path / "theirs"
    )
    assert done.exit_code == 0, done.output
    assert "without" not in done.output
    page = (tmp_path / "theirs/report.html").read_text()
    assert '"errors"' in page or "errors-title" in page  # the player has something to show
    compared = mottrack(
        "compare-runs", tmp_path / "ours", tmp_path / "theirs", "--out", tmp_path / "both"
    )
    assert compared.exit_code == 0, compared.output
    assert f"scenes in common: {len(run.scenes)}" in compared.output
    figures = json.loads((tmp_path / "both/scores.json").read_text())
    found = {f["metric"]: f for f in figures["differences"][0]["figures"]}
    assert found["AMOTA"]["difference"] == pytest.approx(0.0, abs=1e-9)
    assert found["IDS"]["difference"] == 0.0
    settings = (tmp_path / "both/tables/settings.csv").read_text()
    assert 'tracker.kind,"""kalman""","""imported"""' in settings
    assert "Where the runs differ" in (tmp_path / "both/report.html").read_text()


def test_runs_on_other_frames_or_without_a_common_scene_are_not_compared(root_of, tmp_path):
    settings = dataset_of("kitti", root_of("kitti"))
    whole = stored_run(tmp_path / "whole", settings)
    short = stored_run(tmp_path / "short", settings | {"frames": 3})
    first = stored_run(tmp_path / "first", settings | {"scenes": [whole.scenes[0]]})
    second = stored_run(tmp_path / "second", settings | {"scenes": [whole.scenes[1]]})
    other = stored_run(tmp_path / "other", dataset_of("folder", root_of("folder")))
    for runs, message in (
        ((whole, short), r"scene 0000 is not the same in .*frames"),
        ((first, second), "no scene in common"),
        ((whole, other), "other is on folder, .*whole on kitti"),
        ((whole, whole), "named twice"),
        ((whole,), "expected two or more"),
    ):
        command = ["compare-runs", *(run.path for run in runs), "--out", tmp_path / "out"]
        with pytest.raises(MottrackError, match=message) as error:
            raise mottrack(*command).exception
        assert "\n" not in str(error.value)
    told = mottrack("compare-runs", whole.path, first.path, "--out", tmp_path / "out").output
    assert "left out, only in whole: 0001" in told


MOT = "1,1,10,10,20,40,1,-1,-1,-1\n2,1,12,10,20,40,1,-1,-1,-1\n"


def mot_folders(root: Path, tracks: str = MOT) -> tuple[Path, Path]:
    truth, found = root / "data/seq", root / "tracks"
    truth.mkdir(parents=True)
    found.mkdir()
    (truth / "gt.txt").write_text(MOT)
    (found / "seq.txt").write_text(tracks)
    return root / "data", found


def test_image_boxes_are_scored_as_motchallenge_does(tmp_path):
    """`eval mot` equals TrackEval (tests/eval/test_mot.py); here both read the same files."""
    rng = np.random.default_rng(5)
    lines = []
    for frame in range(1, 12):
        for identity in range(1, 6):
            left, top = 90 * identity + 4 * frame, 50 + 3 * identity
            lines.append([frame, identity, left, top, 40, 90])
    truth = "".join(f"{','.join(map(str, r))},1,-1,-1,-1\n" for r in lines)
    kept = [r for r in lines if rng.uniform() < 0.8]
    moved = [[f, i if f < 6 else i + 9, x + rng.normal(0, 6), *rest] for f, i, x, *rest in kept]
    tracks = "".join(f"{','.join(map(str, r))},1,-1,-1,-1\n" for r in moved)
    data, found = mot_folders(tmp_path, tracks)
    (data / "seq/gt.txt").write_text(truth)
    done = mottrack("import", data, "--format", "mot", "--tracks", found, "--out", tmp_path / "run")
    assert done.exit_code == 0, done.output
    official = mottrack(
        "eval", "mot", "--truth", data / "seq/gt.txt", "--tracks", found / "seq.txt",
        "--out", tmp_path / "eval",
    )  # fmt: skip
    assert official.exit_code == 0, official.output
    theirs = json.loads((tmp_path / "eval/mot.json").read_text())["all"]
    ours = json.loads((tmp_path / "run/scores.json").read_text())["runs"][0]["metrics"]["overall"]
    for name, other in (("mota", "mota"), ("idf1", "idf1"), ("hota", "hota")):
        assert ours[name] == pytest.approx(theirs[other], abs=1e-9)
    assert ours["id_switches"] == theirs["ids"] > 0
    back = tmp_path / "back"
    mottrack("tracks", tmp_path / "run", "--format", "mot", "--out", back)
    first = (back / "person/seq.txt").read_text().splitlines()[0].split(",")
    assert list(map(float, first[:6])) == pytest.approx(moved[0], abs=ROUNDED_M)


BAD = (
    ("nuscenes", "nuscenes", "t.json", '{"meta": {}, "results": {}}', "others only"),
    ("nuscenes", "nuscenes", "t.json", "not json", "results"),
    ("kitti", "kitti", "0000.txt", "0 1 Car 0 0 1 2 3\n", "line 1"),
    ("kitti", "kitti", "0000.txt", "0 1 Car 0 0 0 1 2 3 4 1 1 1 0 0 9 0\n" * 2, "each track once"),
    ("kitti", "kitti", "0000.txt", "99 1 Car 0 0 0 1 2 3 4 1 1 1 0 0 9 0\n", "frames of 0000"),
    ("kitti", "kitti", "9999.txt", "", "others only"),
    ("argoverse2", "argoverse2", "t.feather", "x", "unreadable"),
    ("table", "folder", "t.csv", "a,b\n1,2\n", "without id, label"),
    ("table", "folder", "t.csv", "stamp_ns,id,label,score,x,y,z,length,width,height,yaw,colour\n",
     "colour, expected one of"),
    ("table", "folder", "t.csv",
     "stamp_ns,scene,id,label,score,x,y,z,length,width,height,yaw\n"
     "7,synthetic-s0005-0000,1,car,1,0,0,0,1,1,1,0\n", "frame is 7, expected a frame of"),
    ("table", "folder", "t.parquet", "PAR1", "unreadable"),
    ("table", "folder", "t.xlsx", "x", "suffix is .xlsx"),
    ("table", "kitti", "t.csv",
     "stamp_ns,id,label,score,x,y,z,length,width,height,yaw\n0,1,car,1,0,0,0,1,1,1,0\n",
     "a column scene"),
    ("xml", "kitti", "t.xml", "", "unknown format 'xml'"),
    ("mot", "kitti", "0000.txt", MOT, "boxes in an image have no place"),
)  # fmt: skip


@pytest.mark.parametrize(("format_name", "kind", "name", "content", "message"), BAD)
def test_a_bad_file_gives_one_line(root_of, tmp_path, format_name, kind, name, content, message):
    settings = dataset_of(kind, root_of(kind))
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / name).write_text(content)
    path = folder if name.endswith(".txt") else folder / name
    with pytest.raises(MottrackError, match=message) as error:
        import_tracks(Import((path,), format_name, settings), tmp_path / "out")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out/run.json").exists()


@pytest.mark.parametrize("row", ["0,1,1,1,9,9,1", "3,1,1,1,-9,9,1", "1,1,nan,1,9,9,1"])
def test_a_bad_row_of_image_boxes_gives_one_line(tmp_path, row):
    data, found = mot_folders(tmp_path, row + "\n")
    request = Import((found,), "mot", {"kind": "mot", "root": str(data)})
    with pytest.raises(MottrackError, match=r"seq\.txt: line 1") as error:
        import_tracks(request, tmp_path / "out")
    assert "\n" not in str(error.value)


def test_a_run_of_other_classes_is_no_nuscenes_submission(root_of, tmp_path):
    run = stored_run(tmp_path / "run", dataset_of("kitti", root_of("kitti")))
    for command, message in (
        (("tracks", run.path, "--format", "nuscenes", "--out", tmp_path / "x.json"), "class of a"),
        (("tracks", run.path, "--format", "csv", "--out", tmp_path / "x"), "ends with .csv"),
        (("submit", run.path, "--out", tmp_path / "x.json"), "is a run on kitti"),
    ):
        with pytest.raises(MottrackError, match=message):
            raise mottrack(*command).exception
    assert not (tmp_path / "x.json").exists()
