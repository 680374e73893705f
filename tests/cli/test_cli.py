import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mottrack.cli import main


def run_cli(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mottrack", *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=False)


@pytest.mark.parametrize(
    ("statement", "forbidden"),
    [
        ("import mottrack", "scipy pydantic yaml typer torch gtsam numba matplotlib"),
        ("import mottrack.cli", "scipy pydantic torch gtsam numba matplotlib"),
    ],
)
def test_importing_loads_no_heavy_library(statement: str, forbidden: str) -> None:
    code = f"import sys; {statement}; print(*[m for m in {forbidden.split()} if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = found.stdout.split()
    assert loaded == []


def test_a_user_error_is_one_line_without_traceback_and_exit_code_2(tmp_path: Path) -> None:
    done = run_cli("run", "demo", "flow=ipc", "--out", str(tmp_path))
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("mottrack: ")
    assert "demo.yaml: unknown flow source 'ipc' (did you mean 'icp'?); valid: " in done.stderr


def test_list_prints_a_summary_of_each_part() -> None:
    done = run_cli("list", "flows")
    assert done.returncode == 0
    lines = {line.split()[0]: line.split(maxsplit=1)[1] for line in done.stdout.splitlines()}
    assert lines["zero"].startswith("No flow: marks the occupied cells")
    assert all(lines.values())
    unknown = run_cli("list", "metrics")
    assert unknown.returncode == 2
    assert "valid: datasets, flows, objects, trackers" in unknown.stderr


def test_main_turns_a_user_error_into_an_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["mottrack", "run", "no_such_config", "--out", "x"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert "unknown config 'no_such_config'" in capsys.readouterr().err


def test_a_failed_scene_is_named_at_the_end_with_exit_code_3(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1] / "plugins"))
    (tmp_path / "toy.yaml").write_text(
        "dataset: {kind: 'toy_plugins:ToyDataset', scenes: [a, poison]}\n"
        "flow: zero\ntracker: {kind: 'toy_plugins:EchoTracker'}\n"
    )
    done = run_cli("run", str(tmp_path / "toy.yaml"), "--out", str(tmp_path / "out"))
    assert done.returncode == 3, done.stderr
    assert "failed poison: toy/poison.bin: point 7 is nan, expected a finite number" in done.stdout
    assert (tmp_path / "out" / "scores.json").exists()
    assert (tmp_path / "out" / "report.html").exists()


def test_an_error_of_the_file_system_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    done = run_cli("run", "demo", "flow=zero", "--out", str(tmp_path / "file"))
    assert done.returncode == 2
    assert done.stderr == f"mottrack: {tmp_path / 'file'}: File exists\n"


def test_ctrl_c_stops_all_processes_and_leaves_no_partial_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1] / "plugins"))
    (tmp_path / "toy.yaml").write_text(
        "dataset: {kind: 'toy_plugins:ToyDataset', scenes: [a, b, c, d], frames: 40}\n"
        "flow: zero\ntracker: {kind: 'toy_plugins:EchoTracker'}\n"
    )
    out = tmp_path / "out"
    command = [sys.executable, "-m", "mottrack", "run", str(tmp_path / "toy.yaml")]
    run = subprocess.Popen(
        [*command, "--out", str(out), "--workers", "2"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    while run.poll() is None and not list(out.glob("scenes/*.npz")):
        time.sleep(0.02)
    os.killpg(run.pid, signal.SIGINT)  # to the workers as well, like a terminal
    _, complaints = run.communicate(timeout=60)
    assert run.returncode == 130
    assert complaints.strip() == ""
    assert 0 < len(list(out.glob("scenes/*.npz"))) < 8  # four results, four sets of pictures
    assert not list(out.rglob("*.part"))


def test_every_command_of_runs_has_an_example_in_its_help() -> None:
    for command in ("run", "compare", "demo", "list", "report", "paper"):
        shown = run_cli(command, "--help").stdout
        assert f"Example: mottrack {command} " in shown
