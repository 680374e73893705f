import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from mottrack import __version__
from mottrack.cli import app, main
from mottrack.experiment.experiment import load_experiments


def run_cli(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mottrack", *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=False)


@pytest.mark.parametrize(
    ("statement", "forbidden"),
    [
        ("import mottrack", "scipy pydantic yaml typer torch gtsam numba matplotlib"),
        ("import mottrack.cli", "scipy pydantic torch gtsam numba matplotlib"),
        ("import mottrack.studies.example_sets", "torch gtsam matplotlib"),
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
    assert "valid: configs, datasets, flows, objects, trackers" in unknown.stderr


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


def commands(name: str, command: Any) -> Iterator[tuple[str, Any]]:
    yield name, command
    for word, child in getattr(command, "commands", {}).items():
        yield from commands(f"{name} {word}", child)


def test_every_help_has_an_example_and_cuts_nothing_off(capsys: Any) -> None:
    found = dict(commands("mottrack", get_command(app)))
    assert {"mottrack config", "mottrack eval kitti"} <= set(found)
    for name, command in found.items():
        with pytest.raises(SystemExit):
            command.main(["--help"], prog_name=name, terminal_width=80)
        shown = capsys.readouterr().out
        assert f"Example: {name}" in shown, name
        assert not re.search(r"\w\.\.\.$", shown, re.MULTILINE), name


def test_version() -> None:
    assert run_cli("--version").stdout == f"mottrack {__version__}\n"


def test_a_resolved_configuration_is_one_that_gives_the_same_experiment(tmp_path: Path) -> None:
    for overrides in (
        ["flow=icp", "tracker.preset=pillarflow"],
        ["flow=zero", "tracker=fixed_lag"],
    ):
        shown = run_cli("config", "demo", *overrides).stdout
        (tmp_path / "mine.yaml").write_text(shown)
        (resolved,) = load_experiments(str(tmp_path / "mine.yaml"))
        (wanted,) = load_experiments("demo", overrides)
        assert resolved.hash == wanted.hash
        assert "# number of scenes" in shown


def test_a_path_that_does_not_exist_is_told_as_such(tmp_path: Path) -> None:
    for arguments in (
        ["config", "no/such.yaml"],
        ["report", "no/run"],
        ["view", "no/run"],
        ["submit", "no/run", "--out", "x.json"],
        ["check", "no/data"],
        ["merge", "no/shard", "--out", str(tmp_path / "out")],
        ["eval", "capabilities", "no/run", "--out", str(tmp_path / "out")],
    ):
        done = run_cli(*arguments)
        assert done.returncode == 2, arguments
        assert f"{next(a for a in arguments if a[:3] == 'no/')} does not exist" in done.stderr


def test_a_command_starts_within_half_a_second_of_cpu_time() -> None:
    """CPU time, since the machine may be busy; the shortest of three."""
    code = "import os, sys; from mottrack.cli import app; sys.argv[1:] = ARGUMENTS\ntry: app()\n"
    code += "except SystemExit: pass\nprint('cpu', sum(os.times()[:2]))"
    for arguments in (["--help"], ["list", "flows"], ["cache"], ["eval", "kitti", "--help"]):
        command = [sys.executable, "-c", code.replace("ARGUMENTS", repr(arguments))]
        spent = [
            float(subprocess.check_output(command, text=True).rsplit("cpu", 1)[1]) for _ in range(3)
        ]
        assert min(spent) < 0.5, arguments
