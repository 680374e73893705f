"""Damage a file, read it, and say how that ended."""

from __future__ import annotations

import resource
import shutil
import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mottrack.core import MottrackError
from mottrack.core.concerns import ConcernError
from mottrack.core.printed import MAX_MESSAGE
from mottrack.eval.nuscenes.submission_checks import SubmissionError
from tests.fuzz.damage import Damaged
from tests.fuzz.targets import TARGETS, Read, Target

BAD = ("silent", "foreign", "useless", "hang", "memory")
OUTCOMES = ("clear", "warned", "the same", "not told", *BAD)
"""`not told`: other values, but nothing in the content gives the damage away."""
HANG_S = 20.0
MEMORY_KB = 1_000_000
SEVERAL_LINES = (SubmissionError, ConcernError)


class Case(NamedTuple):
    """One damage and its end."""

    target: str
    damage: str
    what: str
    outcome: str
    message: str


def fuzz(root: Path, seed: int, inputs: int) -> list[Case]:
    """Damage every target in turn, `inputs` times in all; each damage of a target comes round."""
    whole = {name: target.read(root) for name, target in TARGETS.items()}
    rngs = {name: np.random.default_rng([seed, k]) for k, name in enumerate(TARGETS)}
    cases: list[Case] = []
    turn = 0
    while len(cases) < inputs:
        for name, target in TARGETS.items():
            if len(cases) < inputs:
                damage = list(target.damages)[(turn + seed) % len(target.damages)]
                cases.append(one(root, Planned(name, damage, rngs[name]), whole[name]))
        turn += 1
    return cases


class Planned(NamedTuple):
    """What is damaged and how."""

    target: str
    damage: str
    rng: Any


def file_of(root: Path, target: Target) -> Path:
    return sorted(root.glob(target.path))[0]


def one(root: Path, planned: Planned, whole: Read) -> Case:
    """Damage one file once, read it, and put it back."""
    target = TARGETS[planned.target]
    file = file_of(root, target)
    data = file.read_bytes()
    damaged = target.damages[planned.damage](data, planned.rng)
    memory_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    file.write_bytes(damaged.data)
    try:
        outcome, message = ending(target, root, damaged, whole)
    finally:
        file.write_bytes(data)
    if time.process_time() - began > HANG_S:
        outcome = "hang"
    if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory_kb > MEMORY_KB:
        outcome = "memory"
    return Case(planned.target, planned.damage, damaged.what, outcome, message)


def ending(target: Target, root: Path, damaged: Damaged, whole: Read) -> tuple[str, str]:
    try:
        read = target.read(root)
    except MottrackError as error:
        return ("clear" if is_clear(error, root) else "useless"), str(error)
    except Exception as error:  # noqa: BLE001 - whatever it is, it is counted
        return "foreign", f"{type(error).__name__}: {error}"
    if not finite(read.values):
        return "silent", "a NaN got through"
    if len(read.warnings) > len(whole.warnings):
        return "warned", str(read.warnings[-1])
    if same(read.values, whole.values):
        return "the same", ""
    return ("silent" if damaged.told else "not told"), ""


def is_clear(error: MottrackError, root: Path) -> bool:
    """One printable line that says where, what, and what was expected."""
    text = str(error)
    lines = text.split("\n")
    return (
        (len(lines) == 1 or isinstance(error, SEVERAL_LINES))
        and all(line.isprintable() for line in lines)
        and len(text) < 30 * MAX_MESSAGE
        and (str(root) in text)
        and (": " in text)
    )


def finite(values: list[Any]) -> bool:
    return all(
        bool(np.isfinite(value).all())
        for value in values
        if isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.ndim != 2
    )


def same(one: list[Any], other: list[Any]) -> bool:
    return len(one) == len(other) and all(
        np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b
        for a, b in zip(one, other, strict=True)
    )


def counted(cases: list[Case]) -> str:
    """Return a table: a line a target, a column an outcome."""
    by_target: dict[str, Counter[str]] = {name: Counter() for name in TARGETS}
    for case in cases:
        by_target[case.target][case.outcome] += 1
    lines = [["target", *OUTCOMES]]
    for name, counts in by_target.items():
        lines.append([name, *(str(counts[outcome]) for outcome in OUTCOMES)])
    total = Counter(case.outcome for case in cases)
    lines.append(["all", *(str(total[outcome]) for outcome in OUTCOMES)])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True))
        for line in lines
    )


def copied(source: Path, to: Path) -> Path:
    shutil.copytree(source, to)
    return to
