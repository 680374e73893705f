"""Files of points of the Point Cloud Library, against one that pypcd4 1.5.1 wrote."""

from __future__ import annotations

import base64

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mottrack.core import DataError
from mottrack.formats.pcd import read_pcd, write_pcd

COMPRESSED = base64.b64decode(
    "VkVSU0lPTiAwLjcKRklFTERTIHggeSB6IGludGVuc2l0eSB0aW1lc3RhbXAKU0laRSA0IDQgNCA0IDgKVFlQRSBGIEYg"
    "RiBGIFUKQ09VTlQgMSAxIDEgMSAxCldJRFRIIDQwCkhFSUdIVCAxClZJRVdQT0lOVCAwLjAgMC4wIDAuMCAxLjAgMC4w"
    "IDAuMCAwLjAKUE9JTlRTIDQwCkRBVEEgYmluYXJ5X2NvbXByZXNzZWQKYgEAAMADAAABAADgHwABgD/gHQMBAEDgHQMA"
    "QCAn4BsDAMAgdwAgICvgjwfgmwBBu0GXQW8AgCFLAKAgAwDAIAMA4CADBABBAAAQIAMAICADADAgAwBAIAMAUCADAGAg"
    "AwBwIAMAgCADAIggAwCQIAMAmCADAKAgAwCoIAMAsCADALggAwDAIAMAyCADANAgAwDYIAMA4CADAOggAwDwIAMA+CAD"
    "BABCAAAEIAMACCADAAwgAwAQIAMAFCADABggAwocQgBAHhgkCgYAAaAHAAKgBwADoAcABKAHAAWgBwAGoAcAB6AHAAig"
    "BwAJoAcACqAHAAugBwAMoAcADaAHAA6gBwAPoAcAEKAHABGgBwASoAcAE6AHABSgBwAVoAcAFqAHABegBwAYoAcAGaAH"
    "ABqgBwAboAcAHKAHAB2gBwAeoAcAH6AHACCgBwAhoAcAIqAHACOgBwAkoAcAJaAHACagBwAnYAcBBgA="
)
"""40 points: x 0 to 3 in tens, y 1.5 and 2.5 in turns, z 0, intensity and time counting up."""
NAMES = ("x", "y", "z", "intensity")


def test_a_compressed_file_of_another_writer(tmp_path):
    path = tmp_path / "a.pcd"
    path.write_bytes(COMPRESSED)
    fields = read_pcd(path, NAMES, ("timestamp", "ring"))
    assert list(fields) == [*NAMES, "timestamp"]
    np.testing.assert_array_equal(fields["x"], np.repeat(np.arange(4.0), 10))
    np.testing.assert_array_equal(fields["y"], np.tile([1.5, 2.5], 20))
    np.testing.assert_array_equal(fields["intensity"], np.arange(40))
    np.testing.assert_array_equal(fields["timestamp"], 1_700_000_000_000_000 + np.arange(40))


def test_what_is_written_is_read(tmp_path):
    columns = {name: np.arange(5, dtype=np.float32) * i for i, name in enumerate(NAMES)}
    columns["timestamp"] = np.arange(5, dtype=np.uint64)
    write_pcd(tmp_path / "a.pcd", columns)
    read = read_pcd(tmp_path / "a.pcd", NAMES, ("timestamp",))
    for name, values in columns.items():
        np.testing.assert_array_equal(read[name], values)


@given(st.binary(max_size=300), st.integers(0, len(COMPRESSED) - 1), st.booleans())
@settings(max_examples=300)
def test_damage_is_told_or_gives_as_many_points(tmp_path_factory, noise, place, cut):
    path = tmp_path_factory.mktemp("pcd") / "a.pcd"
    path.write_bytes(
        COMPRESSED[:place] + (b"" if cut else noise + COMPRESSED[place + len(noise) :])
    )
    try:
        fields = read_pcd(path, NAMES)
    except DataError as error:
        told = error.file
    else:
        told, counts = path, {len(values) for values in fields.values()}
        assert len(counts) == 1
    assert told == path


FAULTS = {
    "text": ((b"DATA binary_compressed", b"DATA ascii"), "DATA is ascii, expected binary"),
    "lost field": ((b"intensity", b"intensitY"), "FIELDS is x y z intensitY"),
    "two of a kind": ((b"x y z", b"x x z"), "fields is"),
    "huge": ((b"POINTS 40", b"POINTS 99999999999"), "points is 99999999999, expected at most"),
    "other size": ((b"POINTS 40", b"POINTS 41"), "bytes unpacked is 960, expected 984"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named(fault, tmp_path):
    (old, new), words = FAULTS[fault]
    path = tmp_path / "a.pcd"
    path.write_bytes(COMPRESSED.replace(old, new))
    with pytest.raises(DataError, match=words):
        read_pcd(path, NAMES)
