"""Ways to produce a fault, and the text that is printed for it."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
import pyarrow as pa
import pyarrow.feather

from mottrack import MottrackError, Pipeline, Pose
from mottrack.cli import main
from mottrack.datasets.check import check_dataset
from mottrack.experiment.experiment import load_to_stream
from mottrack.flow.pillarflow.weights_file import load_weights
from tests.datasets.makers import open_dataset
from tests.fuzz.run import file_of
from tests.fuzz.targets import TARGETS, Read

Printed = Callable[[Path], str]
Faults = dict[str, Printed]
"""The text that is printed, by the number of the row and its input."""
REPOSITORY = Path(__file__).resolve().parents[3]


def said(root: Path, read: Callable[[], object]) -> str:
    """Return the error that reading ends with, or its warnings, as the command line prints them."""
    try:
        found = read()
    except MottrackError as error:
        return str(error).replace(f"{root}/", "")
    warnings = found.warnings if isinstance(found, Read) else []
    text = f"warning: {str(warnings[0]).removeprefix('warning: ')}" if warnings else "accepted"
    return text.replace(f"{root}/", "")


def changed(name: str, change: Callable[[bytes], bytes]) -> Printed:
    """Damage the file of a target, read it, and put it back."""

    def printed(root: Path) -> str:
        target = TARGETS[name]
        file = file_of(root, target)
        data = file.read_bytes()
        file.write_bytes(change(data))
        try:
            return said(root, lambda: target.read(root))
        finally:
            file.write_bytes(data)

    return printed


def replaced(name: str, old: str, new: str, count: int = 1) -> Printed:
    return changed(name, lambda data: data.replace(old.encode(), new.encode(), count))


def rows(name: str, change: Callable[[list[str]], list[str]]) -> Printed:
    def edit(data: bytes) -> bytes:
        return ("\n".join(change(data.decode().splitlines())) + "\n").encode()

    return changed(name, edit)


def record(name: str, **fields: Any) -> Printed:
    def edit(data: bytes) -> bytes:
        content = json.loads(data)
        first = content[0] if isinstance(content, list) else _first_box(content)
        first.update(fields)
        return json.dumps(content).encode()

    return changed(name, edit)


def _first_box(content: dict[str, Any]) -> dict[str, Any]:
    return next(boxes[0] for boxes in content["results"].values() if boxes)


def every_box(name: str, change: Callable[[dict[str, Any]], object]) -> Printed:
    def edit(data: bytes) -> bytes:
        content = json.loads(data)
        for boxes in content["results"].values():
            for box in boxes:
                change(box)
        return json.dumps(content).encode()

    return changed(name, edit)


def popped(name: str) -> Printed:
    return changed(name, lambda data: json.dumps(json.loads(data)[:-1]).encode())


def through_float(data: bytes) -> bytes:
    table = pa.feather.read_table(pa.BufferReader(data))
    at = table.column_names.index("timestamp_ns")
    values = pa.array([int(float(v + 37)) for v in table["timestamp_ns"].to_pylist()], pa.int64())
    out = io.BytesIO()
    pa.feather.write_feather(table.set_column(at, "timestamp_ns", values), out)
    return out.getvalue()


def microseconds(lines: list[str]) -> list[str]:
    shorter = [
        ",".join([str(int(line.split(",")[0]) // 1000), *line.split(",")[1:]]) for line in lines[1:]
    ]
    return [lines[0], *shorter]


def bomb(_data: bytes) -> bytes:
    table = pa.table({n: np.zeros(60_000_000, np.float32) for n in ("x", "y", "z", "intensity")})
    for name in ("laser_number", "offset_ns"):
        table = table.append_column(name, pa.array(np.zeros(60_000_000, np.int8)))
    out = io.BytesIO()
    pa.feather.write_feather(table, out, compression="zstd")
    return out.getvalue()


def experiment(text: str, *overrides: str) -> Printed:
    def printed(root: Path) -> str:
        path = root / "my.yaml"
        path.write_text(text)
        return said(root, lambda: load_to_stream(str(path), list(overrides)))

    return printed


def fed(pipeline: tuple[str, ...], *frames: dict[str, Any]) -> Printed:
    def printed(_root: Path) -> str:
        made = Pipeline.from_config("demo", *pipeline)

        def feed() -> str:
            return [made.feed(**frame) for frame in frames][-1]  # type: ignore[return-value]

        try:
            step: Any = feed()
        except MottrackError as error:
            return str(error)
        field = "no field" if step.field is None else f"{int(step.field.valid.sum())} cells"
        return f"accepted: {field}, {len(step.tracks)} tracks"

    return printed


def frame(k: int, **changes: Any) -> dict[str, Any]:
    points = np.random.default_rng(0).uniform(-30, 30, (3000, 3)) * [1, 1, 0.03] + [0, 0, 1]
    found = {
        "frame": "ego",
        "centre_m": [[9.0, 0.0, 0.8]],
        "size_m": [[4.5, 1.9, 1.6]],
        "yaw_rad": [0.0],
        "label": ["car"],
        "score": [0.9],
    }
    given = {"stamp_ns": k * 10**8, "points": points, "world_T_ego": Pose.identity()}
    return given | {"detections": found} | changes


def jumped(metres: float) -> dict[str, Any]:
    return frame(3, world_T_ego=Pose.from_yaw(0.0, (metres, 0.0, 0.0)))


def weights(old: str, new: str) -> Printed:
    def printed(root: Path) -> str:
        from mottrack.flow.pillarflow.source import SHIPPED

        data = (SHIPPED / "small.safetensors").read_bytes()
        size = int.from_bytes(data[:8], "little")
        text = data[8 : 8 + size].decode()
        text = text.replace(old, new, 1)
        raw = text.encode()
        path = root / "weights.safetensors"
        path.write_bytes(len(raw).to_bytes(8, "little") + raw + data[8 + size :])
        return said(root, lambda: load_weights(path))

    return printed


def command(*arguments: str, word: str = "", with_code: bool = False) -> Printed:
    """What `mottrack` prints for arguments, {root} replaced; only the lines that hold the word."""

    def printed(root: Path) -> str:
        done = called(*(argument.replace("{root}", str(root)) for argument in arguments))
        lines = [line.strip() for line in done.text.splitlines() if word in line]
        code = [f"exit code {done.code}"] if with_code else []
        return "\n".join([*lines, *code]).replace(f"{root}/", "")

    return printed


class Called(NamedTuple):
    """Standard output and error of a command, and how it ended."""

    text: str
    code: object


def called(*arguments: str) -> Called:
    """Run `mottrack` in this process."""
    text = io.StringIO()
    code: object = 0
    with (
        mock.patch.object(sys, "argv", ["mottrack", *arguments]),
        contextlib.redirect_stdout(text),
        contextlib.redirect_stderr(text),
    ):
        try:
            main()
        except SystemExit as stop:
            code = stop.code or 0
    return Called(text.getvalue(), code)


def in_process(code: str, *arguments: str | bytes, **environment: str) -> str:
    """Run Python code in a process of its own; return standard output and error."""
    paths = f"{REPOSITORY}{os.pathsep}{REPOSITORY / 'tests/plugins'}"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={"PATH": os.environ["PATH"], "PYTHONPATH": paths} | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
    )
    return done.stdout.decode(errors="replace").strip()


@contextlib.contextmanager
def copied(root: Path, name: str) -> Iterator[Path]:
    """A copy of one of the small data sets, to be damaged."""
    with contextlib.suppress(FileNotFoundError):
        shutil.rmtree(root / "copy")
    try:
        yield Path(shutil.copytree(root / name, root / "copy" / name))
    finally:
        shutil.rmtree(root / "copy")


def checked(kind: str, damage: Callable[[Path], object], word: str = "") -> Printed:
    """What `check` says of a damaged copy of a data set; only the lines that hold the word."""

    def printed(root: Path) -> str:
        with copied(root, kind) as folder:
            damage(folder)
            try:
                lines = check_dataset(open_dataset(kind, folder), workers=1).lines()
                text = "\n".join(line.strip() for line in lines if word in line)
            except MottrackError as error:
                text = str(error)
        return text.replace(f"{root}/copy/", "")

    return printed


def raised(call: Callable[[Path], object]) -> Printed:
    """The error that a call with the root ends with, or what it returns."""

    def printed(root: Path) -> str:
        try:
            found = call(root)
        except MottrackError as error:
            return str(error).replace(f"{root}/", "")
        return f"accepted: {found}" if found is not None else "accepted"

    return printed
