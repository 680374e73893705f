"""Damages of every format that is read: each is told, or harmless, or can't be known.

The suite runs so many that every damage of every target comes round. More, and other ones:
`MOTTRACK_FUZZ_INPUTS=5000 MOTTRACK_FUZZ_SEEDS=4,5,6 pytest tests/fuzz -s`.
"""

from __future__ import annotations

import os
import resource
from pathlib import Path

import pytest

from mottrack.core import MottrackError
from tests.fuzz.run import BAD, counted, file_of, fuzz, is_clear
from tests.fuzz.targets import TARGETS, write_all

INPUTS = int(os.environ.get("MOTTRACK_FUZZ_INPUTS", 18 * len(TARGETS)))
MAY_BE_LEFT_OUT = {
    "kitti labels",
    "kitti detections",
    "own boxes",
    "own detections",
    "argoverse2 annotations",
}
SEEDS = [int(seed) for seed in os.environ.get("MOTTRACK_FUZZ_SEEDS", "0").split(",")]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mcap", reason="needs the extra: pip install mottrack[ros]")
    folder = tmp_path_factory.mktemp("whole")
    os.environ["MOTTRACK_CACHE"] = str(folder / "cache")
    write_all(folder)
    return folder


@pytest.mark.parametrize("instead", ["a folder", "a broken link", "nothing"])
@pytest.mark.parametrize("name", TARGETS)
def test_something_else_in_the_place_of_a_file(name: str, instead: str, root: Path) -> None:
    """Only a file that may be left out may be missing; never is another thing passed over."""
    target = TARGETS[name]
    warnings = len(target.read(root).warnings)
    file = file_of(root, target)
    data = file.read_bytes()
    file.unlink()
    if instead == "a folder":
        file.mkdir()
    elif instead == "a broken link":
        file.symlink_to("nowhere")
    try:
        told = len(target.read(root).warnings) > warnings
    except MottrackError as error:
        told = is_clear(error, root)
    finally:
        file.rmdir() if instead == "a folder" else file.unlink(missing_ok=True)
        file.write_bytes(data)
    assert told or (instead == "nothing" and name in MAY_BE_LEFT_OUT)


@pytest.mark.parametrize("seed", SEEDS)
def test_damage_is_told_or_harmless_or_unknowable(seed: int, root: Path) -> None:
    cases = fuzz(root, seed, INPUTS)
    print(counted(cases))  # noqa: T201 - shown with -s
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000
    print(f"seed {seed}, {len(cases)} inputs, peak memory {peak_mb} MB")  # noqa: T201
    bad = [case for case in cases if case.outcome in BAD]
    assert not bad, "\n".join(map(str, bad[:20]))
