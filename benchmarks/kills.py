"""Kill and interrupt `run` and `compare` at random moments: are the results the same to the byte?

Each trial starts a command in a fresh folder, ends it after a random part of its usual time, starts
it again until it is done, and compares every stored result and snapshot with those of a run that
nobody disturbed. A third of the trials are ended twice. Scenes are very short, so that
the moments fall on every part of a run: its start, the writing of a result, the scores, its end.

    ends: SIGKILL of the whole process group, of the driver alone, of one worker; SIGINT as by
          Ctrl-C; SIGTERM of the driver.

--count N trials (200, with --quick 6), --seed of the moments; the exit code is 1 if one differs.
"""

from __future__ import annotations

import hashlib
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from _common import arguments, report

SCENES = ("dataset.scenes=3", "dataset.duration_s=0.4", "dataset.seed=3", "snapshots.scenes=1")
COMMANDS = {
    "run": ("run", "demo", *SCENES, "flow=zero", "tracker=kalman", "--workers", "1"),
    "compare": ("compare", "demo", *SCENES, "flow=zero,ground_truth", "--workers", "2"),
}
USED = (
    "mottrack.runs.comparison",
    "mottrack.runs.terminal",
    "mottrack.report.page",
    "mottrack.trackers.kalman.tracker",
    "mottrack.flow.ground_truth",
    "mottrack.datasets.synthetic.dataset",
    "mottrack.objects.detections",
)
"""Imported once: each command is a fork, which saves the seconds of importing them."""
ENDS = ("kill all", "kill driver", "kill worker", "interrupt", "terminate")
LONGEST_S = 300.0
"""No run of these scenes takes so long, on however busy a machine: one that does hangs."""


def main() -> None:
    options = arguments(__doc__ or "", count=int, seed=int)
    count = options.count or (6 if options.quick else 200)
    from mottrack.cli import app

    for module in USED:
        import_module(module)
    with tempfile.TemporaryDirectory() as folder:
        rows = trials(app, Path(folder), count, options.seed or 0)
    keys = ("trials", "same", "late")
    total = {"command": "all", "ended by": "all"} | {k: sum(r[k] for r in rows) for k in keys}
    report([*rows, total], options.json)
    if total["same"] != total["trials"]:
        raise SystemExit(1)


def trials(app: Callable[..., object], root: Path, count: int, seed: int) -> list[dict[str, Any]]:
    """Return a row for each command and end: trials, those with the same bytes, late ends."""
    whole, seconds = {}, {}
    for name, command in COMMANDS.items():
        began = time.monotonic()
        finish(app, command, root / name)
        whole[name], seconds[name] = contents(root / name), time.monotonic() - began
    counts: dict[str, Any] = {"trials": 0, "same": 0, "late": 0}
    rows = [{"command": name, "ended by": end} | counts for end in ENDS for name in COMMANDS]
    rng = random.Random(seed)
    for trial in range(count):
        row, out = rows[trial % len(rows)], root / f"trial-{trial}"
        name, command = row["command"], COMMANDS[row["command"]]
        for _ in range(2 if trial % 3 == 0 else 1):
            process = started(app, command, out)
            time.sleep(rng.random() * seconds[name])
            row["late"] += not ended(process, row["ended by"], rng)
        finish(app, command, out)
        same = contents(out) == whole[name] and not list(out.rglob("*.part"))
        row["trials"] += 1
        row["same"] += same
        print(trial, name, row["ended by"], "same" if same else "DIFFERS", file=sys.stderr)
        shutil.rmtree(out)
    return rows


def started(app: Callable[..., object], command: tuple[str, ...], out: Path) -> int:
    """Return the number of a new process, the leader of a group of its own, that runs a command."""
    process = os.fork()
    if process:
        return process
    os.setsid()
    silent = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(silent, stream)
    try:
        app([*command, "--out", str(out)])
    except SystemExit as error:
        os._exit(error.code if isinstance(error.code, int) else 1)
    except BaseException:  # noqa: BLE001 - an interrupt among others: the process has ended
        os._exit(1)
    os._exit(0)


def ended(process: int, end: str, rng: random.Random) -> bool:
    """End a running command; return whether it was still running."""
    if end == "kill worker":
        workers = workers_of(process)
        if workers:
            os.kill(rng.choice(workers), signal.SIGKILL)
        return wait(process) != 0 or bool(workers)
    number = {"kill all": signal.SIGKILL, "kill driver": signal.SIGKILL}.get(end, signal.SIGTERM)
    number = signal.SIGINT if end == "interrupt" else number
    try:
        if end in ("kill all", "interrupt"):
            os.killpg(process, number)
        else:
            os.kill(process, number)
    except ProcessLookupError:
        pass  # it has just started and has no group yet, or it has ended
    return wait(process) != 0


def workers_of(driver: int) -> list[int]:
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat = (folder / "stat").read_text().rpartition(")")[2].split()
            line = (folder / "cmdline").read_bytes()
        except OSError:
            continue
        if int(stat[1]) == driver and b"spawn_main" in line:
            found.append(int(folder.name))
    return found


def wait(process: int) -> int:
    end = time.monotonic() + LONGEST_S
    while time.monotonic() < end:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return status
        time.sleep(0.01)
    os.killpg(process, signal.SIGKILL)
    raise SystemExit(f"process {process} hangs")


def finish(app: Callable[..., object], command: tuple[str, ...], out: Path) -> None:
    """Run a command to its end."""
    status = wait(started(app, command, out))
    if status:
        raise SystemExit(f"{' '.join(command)} ended with {status}")


def contents(out: Path) -> dict[str, str]:
    """Return the digest of every result and snapshot, of settings, and of what runs were made of.

    The other files hold seconds that stages took.
    """
    files = [*out.rglob("*.npz"), *out.rglob("config.yaml"), *out.rglob("run.json")]
    return {
        str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(files)
    }


if __name__ == "__main__":
    main()
