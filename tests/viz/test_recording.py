"""What a rerun recording holds, read back by rerun's own tool."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from mottrack.core.errors import ConfigError, InputError
from mottrack.viz.recording import Recording


def test_a_scene_is_recorded(result, snapshot, tmp_path):
    pytest.importorskip("rerun")
    path = tmp_path / "new" / "scene.rrd"
    recording = Recording.of("scene")
    recording.write_to(path)
    recording.log(result, [snapshot])
    tool = [sys.executable, "-m", "rerun", "rrd"]
    printed = subprocess.run([*tool, "print", path], capture_output=True, text=True, check=True)
    rows = {}
    for number, entity in re.findall(r"with (\d+) rows .* - (/\S+) - ", printed.stdout):
        rows[entity] = rows.get(entity, 0) + int(number)
    of_every_frame = {"/world/ego", "/world/truth", "/world/tracks", "/world/tracks/velocity"}
    assert {entity for entity, number in rows.items() if number == 3} >= of_every_frame
    assert {rows[f"/world/ego/{part}"] for part in ("points", "flow")} == {1}
    subprocess.run([*tool, "verify", path], capture_output=True, check=True)


def test_without_rerun_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ConfigError, match=r"pip install 'mottrack\[viz\]'"):
        Recording.of("scene")


def test_a_recording_has_an_ending_of_its_own(tmp_path):
    pytest.importorskip("rerun")
    with pytest.raises(InputError, match=r"\.rrd"):
        Recording.of("scene").write_to(tmp_path / "scene.txt")
