"""Where it is run: no home, another locale, odd paths, little memory, a full disk, forks."""

from __future__ import annotations

import multiprocessing
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from mottrack import Pipeline
from mottrack.core import ConfigError
from mottrack.core.storage import utf8, write_bytes

REPOSITORY = Path(__file__).resolve().parents[2]
SETTINGS = ("flow=zero", "score_flow=false", "dataset.scenes=1", "dataset.duration_s=0.4")
BARE = {"PATH": os.environ["PATH"], "PYTHONPATH": str(REPOSITORY)}
ELSEWHERE = {
    "HOME": "/nonexistent",
    "LC_ALL": "C",
    "LANG": "tr_TR.UTF-8",
    "PYTHONUTF8": "0",  # Python itself would replace the C locale by UTF-8
    "PYTHONCOERCECLOCALE": "0",
    "TZ": "Asia/Kathmandu",
}


def mottrack(*arguments: str | bytes, **environment: str) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "mottrack", *arguments]
    return subprocess.run(command, env=BARE | environment, capture_output=True, check=False)


def results(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in out.glob("scenes/*.npz")}


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux alone")
def test_another_locale_odd_paths_and_no_home_change_no_byte(tmp_path: Path) -> None:
    odd = tmp_path / "out ü ☃ \udcff of mine"
    name = "name=Straße ☃ \udce9"
    done = mottrack(
        *("run", "demo", *SETTINGS, name, "--workers", "1", "--out"), os.fsencode(odd), **ELSEWHERE
    )
    assert done.returncode == 0, done.stderr.decode()
    assert b"Traceback" not in done.stderr
    assert (odd / "report.html").read_text(encoding="utf-8").count("Straße ☃") > 0
    usual = tmp_path / "usual"
    done = mottrack("run", "demo", *SETTINGS, "--workers", "1", "--out", str(usual))
    assert done.returncode == 0, done.stderr.decode()
    assert results(odd) == results(usual)
    assert len(results(usual)) == 3  # results, objects, snapshots
    again = mottrack("report", os.fsencode(odd), **ELSEWHERE)
    assert again.returncode == 0, again.stderr.decode()


def test_bytes_of_another_locale_become_the_text_that_was_meant() -> None:
    meant = "Straße ☃"
    assert utf8(meant.encode().decode("ascii", "surrogateescape")) == meant.encode()
    assert utf8("caf\udce9") == "caf\ufffd".encode()
    assert utf8("half a pair \ud83d") == b"half a pair ?"


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """As on a disk with so many bytes left: writing more is refused by the system."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def test_no_space_left_names_the_file_and_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "result.npz"
    write_bytes(path, b"old")
    with files_of_at_most(1000), pytest.raises(OSError, match="result") as caught:
        write_bytes(path, b"x" * 5000)
    assert caught.value.filename == str(path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


POINTS = np.random.default_rng(0).uniform(-15, 15, (500, 3))
FORKED = {
    "dogma": ("flow=dogma", "flow.filter.particles=500", "flow.filter.births=50"),
    "pillarflow": ("flow=pillarflow", "flow.weights=small"),
}


def _steps(pipeline: Pipeline, first: int, answer: multiprocessing.SimpleQueue | None) -> None:
    try:
        for k in (first, first + 1):
            step = pipeline.feed(k * 10**8, POINTS, np.eye(4))
        found: object = step.field is not None
    except ConfigError as error:
        found = str(error)
    if answer is not None:
        answer.put(found)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.parametrize("flow", FORKED)
def test_a_fork_goes_on_or_says_why_it_can_not(flow: str) -> None:
    """Threads do not survive a fork; a child that waits for them would wait for ever."""
    grid = ("grid.x_min_m=-16", "grid.x_max_m=16", "grid.y_min_m=-16", "grid.y_max_m=16")
    pipeline = Pipeline.from_config("demo", "objects=clusters", *FORKED[flow], *grid)
    _steps(pipeline, 0, None)
    context = multiprocessing.get_context("fork")
    answer = context.SimpleQueue()
    child = context.Process(target=_steps, args=(pipeline, 2, answer))
    child.start()
    child.join(60)
    hangs = child.is_alive()
    child.kill()
    assert not hangs
    found = answer.get()
    assert found is True if flow == "dogma" else "spawn" in str(found)
