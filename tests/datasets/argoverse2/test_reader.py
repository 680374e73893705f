"""The Argoverse 2 reader on published logs, and its errors."""

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pytest

from mottrack.core import DataError
from mottrack.datasets.argoverse2.config import Argoverse2Config
from mottrack.datasets.argoverse2.dataset import Argoverse2
from mottrack.lidar.in_boxes import points_in_boxes

LOG = "adcf7d18-0510-35b0-a2fa-b4cea13a6d76"


def scene_of(root, name, **options):
    return Argoverse2(Argoverse2Config(root=root, **options)).scene(name)


@pytest.mark.parametrize("name", [LOG, "pandaset-002"])
def test_points_in_boxes_are_those_that_were_published(shared_data, name):
    """The annotators counted the returns in each cuboid; we find the very same numbers."""
    scene = scene_of(shared_data / "argoverse2", name, require_sweeps=True)
    frame, sweep = scene.frame(0), scene.sweep(0)
    ego = frame.truth.transformed(frame.world_T_ego.inverse(), "ego")
    found = points_in_boxes(sweep.xyz_m, ego.centre_m, ego.size_m, ego.yaw_rad)
    np.testing.assert_array_equal(np.diff(found.start), frame.truth.num_points)


def test_published_log(shared_data):
    scene = scene_of(shared_data / "argoverse2", LOG)
    frames = [scene.frame(i) for i in range(len(scene))]
    identities = {i for frame in frames for i in frame.truth.id.tolist()}
    assert (len(frames), len(identities), scene.has_sweeps) == (156, 146, False)
    truth = frames[0].truth
    bottom = truth.centre_m[:, 2] - truth.size_m[:, 2] / 2
    height = scene.ground_height(truth.centre_m[:, :2])
    # the map's ground is where the cuboids stand
    assert np.nanmedian(np.abs(height - bottom)) < 0.1
    assert np.isnan(scene.ground_height(np.array([[1e6, 1e6]]))).all()


def test_pandaset_moves_as_its_boxes_point(shared_data):
    scene = scene_of(shared_data / "argoverse2", "pandaset-002")
    truth = scene.frame(15).truth
    speed = np.hypot(*truth.velocity_mps.T)
    fast = speed > 3.0
    course = np.arctan2(truth.velocity_mps[fast, 1], truth.velocity_mps[fast, 0])
    apart = np.abs((course - truth.yaw_rad[fast] + np.pi) % (2 * np.pi) - np.pi)
    assert fast.sum() > 5
    assert np.degrees(np.median(apart)) < 5.0


@pytest.fixture
def log(written_roots, tmp_path):
    """A written log whose annotations and poses may be edited."""
    source = next((written_roots["argoverse2"] / "val").iterdir())
    for name in ("annotations.feather", "city_SE3_egovehicle.feather"):
        target = tmp_path / "val" / "log" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes((source / name).read_bytes())
    return tmp_path / "val" / "log"


def edit(path, name, change):
    table = pyarrow.feather.read_table(path, memory_map=False)
    values = table[name].to_pylist()
    change(values)
    index = table.column_names.index(name)
    column = pa.array(values, type=table.schema.field(name).type)
    pyarrow.feather.write_feather(table.set_column(index, name, column), path)


FAULTS = {
    "NaN": ("annotations", "tx_m", lambda v: v.__setitem__(0, float("nan")), "tx_m of row 0"),
    "empty": ("annotations", "tx_m", lambda v: v.__setitem__(0, None), "empty in 1 rows"),
    "size": ("annotations", "width_m", lambda v: v.__setitem__(0, -1.0), "size of row 0"),
    "turn": ("annotations", "qw", lambda v: v.__setitem__(0, 3.0), "unit quaternion"),
    "points": (
        "annotations",
        "num_interior_pts",
        lambda v: v.__setitem__(0, -3),
        "num_interior_pts of row 0 is -3, expected in 0",
    ),
    "place": (
        "city_SE3_egovehicle",
        "tx_m",
        lambda v: v.__setitem__(1, 1e300),
        r"place of row 1 is \[1e\+300.*within 1e\+08 m",
    ),
    "twice": ("annotations", "track_uuid", lambda v: v.__setitem__(1, v[0]), "each track once"),
    "stamp": (
        "city_SE3_egovehicle",
        "timestamp_ns",
        lambda v: v.__setitem__(1, v[0]),
        "each stamp once",
    ),
    "pose": (
        "city_SE3_egovehicle",
        "timestamp_ns",
        lambda v: v.__setitem__(1, 5),
        "pose is missing",
    ),
}


def test_detections_at_other_times_are_not_taken_for_none(written_roots, tmp_path):
    """Microseconds in the column of nanoseconds would otherwise read as an empty detector."""
    root = written_roots["argoverse2"]
    path = tmp_path / "detections.feather"
    path.write_bytes((root / "detections.feather").read_bytes())
    edit(path, "timestamp_ns", lambda v: v.__setitem__(slice(None), [1 + t // 1000 for t in v]))
    name = next((root / "val").iterdir()).name
    with pytest.raises(DataError, match=r"row 0 is 1, expected the stamp of a pose.*452 of 452"):
        scene_of(root, name, detections=path).frame(0)


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named(log, fault):
    name, column, change, message = FAULTS[fault]
    path = log / f"{name}.feather"
    edit(path, column, change)
    with pytest.raises(DataError, match=message) as caught:
        scene_of(log.parents[1], "log").frame(0)
    assert caught.value.file == path


def test_stamps_that_went_through_float64_are_refused(log):
    """Rounded by up to 32 ns, most rows used to be dropped without a word."""
    edit(log / "annotations.feather", "timestamp_ns", lambda v: v.__setitem__(0, v[0] + 32))
    root, name = log.parents[1], log.name
    message = r"pose is missing, expected a row with timestamp_ns 32"
    with pytest.raises(DataError, match=message):
        scene_of(root, name)
    path = log / "detections.feather"
    path.write_bytes((log / "annotations.feather").read_bytes())
    table = pyarrow.feather.read_table(path, memory_map=False)
    table = table.append_column("score", pa.array([0.5] * table.num_rows))
    table = table.append_column("log_id", pa.array([name] * table.num_rows))
    pyarrow.feather.write_feather(table, path)
    (log / "annotations.feather").unlink()
    sweep = log / "sensors/lidar/0.feather"
    sweep.parent.mkdir(parents=True)
    sweep.touch()
    with pytest.raises(DataError, match=r"the nearest is 32 ns away; 1 of .*float64 keeps no nano"):
        scene_of(root, name, detections=path).frame(0)


def test_annotations_under_another_name_are_named(log):
    (log / "annotations.feather").rename(log / "annotations_with_ego.feather")
    for sweep in (log / "sensors/lidar").glob("*.feather"):
        sweep.unlink()
    root, name = log.parents[1], log.name
    with pytest.raises(DataError, match=r"none \(there is annotations_with_ego\.feather\)"):
        scene_of(root, name)
