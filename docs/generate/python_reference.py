"""The Python reference: signature, description and fields of every public name, page by page."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from importlib import import_module
from itertools import pairwise
from typing import Any

from pieces import paragraphs

PAGES = {
    "data": (
        "Boxes, sweeps, flow, results",
        "mottrack.Objects mottrack.Tracks mottrack.VelocityMeasurement mottrack.Sweep "
        "mottrack.Pose mottrack.BevGrid mottrack.FlowField mottrack.SceneResult mottrack.Frame "
        "mottrack.core.Truth mottrack.core.motion.fuse_velocities "
        "mottrack.core.velocity_errors.VelocityErrorModel",
    ),
    "functions": (
        "Run, compare, score, plot",
        "mottrack.run mottrack.compare mottrack.load mottrack.evaluate mottrack.plot_boxes "
        "mottrack.plot_flow mottrack.plot_scene mottrack.plot_differences "
        "mottrack.runs.comparison.Comparison mottrack.runs.scored_run.ScoredRun "
        "mottrack.experiment.experiment.load_experiments mottrack.pipeline.scene_run.run_scene "
        "mottrack.eval.evaluation.score mottrack.eval.flow_error.flow_table "
        "mottrack.eval.velocity_error.velocity_table mottrack.eval.nuscenes.metrics.evaluate",
    ),
    "streaming": (
        "Streaming and trackers",
        "mottrack.Pipeline mottrack.pipeline.stream.Step mottrack.pipeline.latency.LatencyReport "
        "mottrack.pipeline.latency.StageLatency mottrack.KalmanTracker mottrack.FixedLagTracker",
    ),
    "plugins": (
        "Interfaces of plug-ins",
        "mottrack.core.interfaces.FlowSource mottrack.core.interfaces.FlowSourceBase "
        "mottrack.core.interfaces.ObjectSource mottrack.core.interfaces.ObjectSourceBase "
        "mottrack.core.interfaces.Tracker mottrack.core.interfaces.OfflineTracker "
        "mottrack.core.interfaces.FrameObserver mottrack.core.interfaces.Scene "
        "mottrack.core.interfaces.Dataset",
    ),
    "tables": (
        "Stored tables and errors",
        "mottrack.core.tables.FrameTable mottrack.core.tables.TruthTable "
        "mottrack.core.tables.TrackTable mottrack.core.tables.FlowSamples "
        "mottrack.core.errors.MottrackError mottrack.core.errors.InputError "
        "mottrack.core.errors.DataError mottrack.core.errors.ConfigError "
        "mottrack.core.errors.ResultError mottrack.core.errors.MottrackWarning",
    ),
}
"""File to its title and the names on it."""
NOTE = "Shape, unit and frame of every array are given at its field. This page is generated.\n"


def pages() -> dict[str, str]:
    """Return file name to page."""
    return {f"python_{name}.md": _page(title, names) for name, (title, names) in PAGES.items()}


def _page(title: str, names: str) -> str:
    parts = [f"# {title}\n", NOTE]
    for name in names.split():
        module, _, word = name.rpartition(".")
        parts += list(_described(word, getattr(import_module(module), word), module))
    return "\n".join(parts)


def _described(name: str, thing: Any, module: str) -> Iterator[str]:
    yield f"## {name}\n"
    yield f"```\n{module}.{name}{_signature(thing)}\n```\n"
    yield _text(thing)
    if not inspect.isclass(thing):
        return
    if is_dataclass(thing) and (told := list(_fields(thing))):
        yield "\n".join(["| field | type | |", "|---|---|---|", *told]) + "\n"
    for word, member in vars(thing).items():
        function = member.__func__ if isinstance(member, classmethod | staticmethod) else member
        function = function.fget if isinstance(function, property) else function
        if word[0] != "_" and inspect.isfunction(function):
            how = "" if isinstance(member, property) else _signature(function)
            yield f"**`{word}{how}`**\n\n{_text(function)}"


def _signature(thing: Any) -> str:
    if inspect.isclass(thing) and (is_dataclass(thing) or issubclass(thing, Exception)):
        return ""
    try:
        found = inspect.signature(thing)
    except (TypeError, ValueError):
        return ""
    kept = [
        p.replace(annotation=p.empty)
        for n, p in found.parameters.items()
        if n not in ("self", "cls")
    ]
    return str(inspect.Signature(kept))


def _text(thing: Any) -> str:
    """Return the docstring; its sections ``Args:`` and the like become lists."""
    lines = inspect.cleandoc(thing.__doc__ or "").splitlines()
    told, section = [], False
    for line in lines:
        if line.rstrip() in ("Args:", "Raises:", "Returns:", "Yields:", "Example:"):
            told += ["", f"*{line.rstrip()[:-1]}*", ""]
            section = line.rstrip() != "Example:"
            continue
        if section and line.startswith("    ") and not line.startswith("     "):
            told.append(f"* {line.strip()}")
        elif section and line.startswith("     "):
            told.append(f"  {line.strip()}")
        else:
            told.append(line)
    return paragraphs("\n".join(told))


def _fields(thing: Any) -> Iterator[str]:
    about = {k: v for cls in reversed(thing.__mro__) for k, v in _attribute_texts(cls).items()}
    for field in fields(thing):
        if field.name[0] != "_":
            kind = str(field.type).replace("|", "\\|")
            text = (
                " ".join(about.get(field.name, "").split()).replace("``", "`").replace("|", "\\|")
            )
            yield f"| `{field.name}` | `{kind}` | {text} |"


def _attribute_texts(cls: type[Any]) -> dict[str, str]:
    """Return the text that stands below each annotated attribute of a class."""
    try:
        source = textwrap.dedent(inspect.getsource(cls))
    except (OSError, TypeError):
        return {}
    body = ast.parse(source).body[0].body  # type: ignore[attr-defined]
    found = {}
    for item, after in pairwise(body):
        text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        if isinstance(item, ast.AnnAssign) and text:
            found[item.target.id] = str(after.value.value)
    return found
