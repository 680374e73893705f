"""What survives being written and read: one body over the embedded world and each format."""

import numpy as np

from mottrack.lidar.in_boxes import points_in_boxes

# metres that the format's own rounding may move a point, a box, a pose
POINT_M = {"synthetic": 1e-6, "kitti": 1e-6, "nuscenes": 2e-5, "argoverse2": 0.07}
POINT_M |= {"t4": 2e-5, "truckscenes": 2e-5, "folder": 0.0, "ros": 2e-5}
BOX_M = {"synthetic": 1e-9, "kitti": 5e-6, "nuscenes": 1e-9, "argoverse2": 1e-9}
BOX_M |= {"t4": 1e-9, "truckscenes": 1e-9, "folder": 1e-9, "ros": 1e-9}
"""KITTI writes six digits, Argoverse stores half floats: 6 cm beyond 64 m."""


def frames(scene):
    return [scene.frame(i) for i in range(len(scene))]


def pairs(written):
    """Frames as read beside those of the source; key frames at 2 Hz end with the last of them."""
    read, source = frames(written.read), frames(written.source)
    if written.format in ("nuscenes", "truckscenes"):
        last = max(i for i, frame in enumerate(source) if frame.is_key)
        source = source[: last + 1]
    return list(zip(read, source, strict=True))


def test_stamps_survive(written):
    """Up to the microsecond of nuScenes; KITTI counts from the first frame."""
    stamps, source = np.array([(r.stamp_ns, s.stamp_ns) for r, s in pairs(written)]).T
    assert np.abs((stamps - stamps[0]) - (source - source[0])).max() <= 1000


def test_poses_are_rigid_and_survive(written):
    for read, source in pairs(written):
        rotation = read.world_T_ego.rotation
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) > 0
        expected = written.read_T_source @ source.world_T_ego
        np.testing.assert_allclose(read.world_T_ego.matrix, expected.matrix, atol=1e-7)


def test_boxes_contain_their_points(written):
    """At least 95 % of the returns that the labels count lie in the boxes that are read.

    Of the rehearsal of nuScenes 90 %: the vehicle's own body hides the others.
    """
    counted = inside = 0
    for index, frame in enumerate(frames(written.read)):
        if frame.is_key and frame.truth is not None:
            source = written.source.frame(index).truth
            ego = frame.truth.transformed(frame.world_T_ego.inverse(), "ego")
            # a rolling scan and odometry blur a box by centimetres
            size = ego.size_m + 0.2
            xyz = written.read.sweep(index).xyz_m
            found = np.diff(points_in_boxes(xyz, ego.centre_m, size, ego.yaw_rad).start)
            # racks are counted by the writer alone
            labelled = np.maximum(source.num_points[_same_objects(source, frame.truth, written)], 0)
            counted += labelled.sum()
            inside += np.minimum(found, labelled).sum()
    assert counted > 1000
    assert inside > (0.9 if written.format == "nuscenes" else 0.95) * counted


def test_static_truth_stays_put_in_the_world(written):
    places: dict[int, list] = {}
    for frame, source in pairs(written):
        if frame.truth is not None and frame.is_key:
            rows = _same_objects(source.truth, frame.truth, written)
            still = np.hypot(*source.truth.velocity_mps[rows].T) < 1e-6
            for identity, centre in zip(
                frame.truth.id[still].tolist(), frame.truth.centre_m[still], strict=True
            ):
                places.setdefault(identity, []).append(centre)
    tracks = [np.array(p) for p in places.values() if len(p) > 1]
    assert len(tracks) > 3
    assert max(np.ptp(track, axis=0).max() for track in tracks) < 0.01


def test_truth_survives(written):
    for frame, source in pairs(written):
        if frame.truth is None:
            assert not frame.is_key
            continue
        moved = source.truth.transformed(written.read_T_source, "world")
        rows = _same_objects(source.truth, frame.truth, written)
        assert len(rows) == len(frame.truth)
        atol = BOX_M[written.format]
        np.testing.assert_allclose(frame.truth.centre_m, moved.centre_m[rows], atol=atol)
        np.testing.assert_allclose(frame.truth.size_m, moved.size_m[rows], atol=atol)
        turn = (frame.truth.yaw_rad - moved.yaw_rad[rows] + np.pi) % (2 * np.pi) - np.pi
        # a heading is about the vertical of its frame, and KITTI's world leans a little
        assert np.abs(turn).max(initial=0) < (2e-3 if written.format == "kitti" else 1e-9)


def test_truth_velocity_is_the_movement(written):
    """Readers derive velocities from positions; they agree with the world's own."""
    middle = [f for f in frames(written.read) if f.is_key][1]
    index = [f.stamp_ns for f in frames(written.read)].index(middle.stamp_ns)
    source = written.source.frame(index).truth
    rows = _same_objects(source, middle.truth, written)
    moved = source.transformed(written.read_T_source, "world")
    error = np.linalg.norm(middle.truth.velocity_mps - moved.velocity_mps[rows], axis=1)
    # centred over 0.2 s or 1 s, so only turning and braking tell
    assert np.nanmedian(error) < 0.05


def test_detections_survive(written):
    total = 0
    for frame, source in pairs(written):
        if frame.detections is None:
            assert not frame.is_key
            continue
        moved = source.detections.transformed(written.read_T_source, "world")
        for centre, size in zip(frame.detections.centre_m, frame.detections.size_m, strict=True):
            near = np.abs(moved.centre_m - centre).max(axis=1)
            best = int(near.argmin())
            assert near[best] <= BOX_M[written.format]
            np.testing.assert_allclose(size, moved.size_m[best], atol=1e-5)
            total += 1
    assert total > 20


def order_of(name, sweep):
    """The order of a sweep's points in a format: TruckScenes has six LiDARs, a sixth turn each."""
    if name != "truckscenes":
        return np.arange(len(sweep))
    azimuth = np.arctan2(sweep.xyz_m[:, 1], sweep.xyz_m[:, 0]).astype(np.float64)
    return np.argsort((azimuth % (2 * np.pi)) // (np.pi / 3), kind="stable")


def test_sweeps_survive(written):
    for index in (0, 1, len(written.read) - 1):
        read, source = written.read.sweep(index), written.source.sweep(index)
        atol, source = POINT_M[written.format], source.select(order_of(written.format, source))
        np.testing.assert_allclose(read.xyz_m, source.xyz_m, atol=atol)
        np.testing.assert_allclose(read.reflectance, source.reflectance, atol=0.5 / 255 + 1e-6)
        if written.format in ("nuscenes", "argoverse2"):
            np.testing.assert_array_equal(read.ring, source.ring)
            np.testing.assert_allclose(read.origin_m, source.origin_m, atol=1e-12)


def _same_objects(source, truth, written):
    """Rows of the source's truth, in the order of what was read: by place, as ids are renamed."""
    moved = source.transformed(written.read_T_source, "world")
    distance = np.linalg.norm(truth.centre_m[:, None] - moved.centre_m[None], axis=2)
    rows = distance.argmin(axis=1) if len(source) else np.zeros(0, int)
    assert len(set(rows.tolist())) == len(truth)
    return rows


def test_identities_are_kept(written):
    """One identity follows one object: it never jumps farther than objects move."""
    last: dict[int, tuple[int, np.ndarray]] = {}
    for frame in frames(written.read):
        if frame.truth is None:
            continue
        for identity, centre in zip(frame.truth.id.tolist(), frame.truth.centre_m, strict=True):
            if identity in last:
                stamp, before = last[identity]
                assert np.linalg.norm(centre - before) < 40.0 * (frame.stamp_ns - stamp) * 1e-9
            last[identity] = (frame.stamp_ns, centre)
