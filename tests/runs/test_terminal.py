"""What a user sees while runs work, and when they have ended."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from mottrack.eval.label_free import ERROR
from mottrack.eval.paired import MetricKey, PairedDifference
from mottrack.formats.text_table import Column, TextTable, fitted
from mottrack.runs.conclusion import conclusion
from mottrack.runs.differences import RunDifferences
from mottrack.runs.progress import TerminalProgress, WorkDone, duration
from mottrack.runs.tasks import Outcome, TaskProgress

texts = st.text("abcdefgh+_: ", min_size=1, max_size=70)


@st.composite
def tables(draw: Any) -> TextTable:
    columns = draw(st.integers(1, 12))
    names = tuple(Column(draw(st.text("abc", min_size=1, max_size=20))) for _ in range(columns))
    row = st.tuples(texts, *[st.integers(-9, 10**12) for _ in range(columns - 1)])
    return TextTable("t", draw(texts), names, tuple(draw(st.lists(row, min_size=1, max_size=4))))


@given(tables(), st.sampled_from([60, 80, 120]))
def test_no_line_of_a_table_is_wider_than_the_terminal_and_nothing_is_lost(
    table: TextTable, width: int
) -> None:
    shown = fitted(table, width)
    assert max(map(len, shown.splitlines())) <= width
    digits = [str(cell) for row in table.rows for cell in row[1:]]
    assert all(number in shown for number in digits)
    letters = re.sub(r"[-0-9\s]", "", shown)  # of all but numbers and rules: names are wrapped
    assert all(re.sub(r"\s", "", str(row[0])) in letters for row in table.rows)


def test_the_time_left_counts_frames_from_the_first_one_on() -> None:
    now = iter([10.0, 20.0, 30.0, 30.0])
    work = WorkDone(tasks=5, todo=4, clock=lambda: next(now))
    folders = (Path("a"), Path("b"))
    work.advances(TaskProgress("s", folders, 0, 10))
    assert work.left == ""
    work.advances(TaskProgress("s", folders, 5, 10))
    assert work.share == pytest.approx(0.25)  # half of two of four scenes
    assert work.left == "30 s left"  # a quarter took 10 s
    work.ends(Outcome("s", folder=folders[0]))
    assert work.share == pytest.approx(0.375)
    work.advances(TaskProgress("s", folders[:1], 10, 10))  # a cluster tells it after the end
    assert work.share == pytest.approx(0.375)
    assert work.counted == "2/5 scenes"
    assert [duration(s) for s in (0.2, 59, 150, 7800)] == ["1 s", "59 s", "2 min", "2 h 10 min"]


def test_a_pipe_gets_plain_lines_and_is_told_once_of_compilation() -> None:
    file = io.StringIO()
    with TerminalProgress(Console(file=file, width=40)) as progress:
        progress.begin("Demo, 2 runs", 2, 2)
        progress.compiling()
        progress.compiling()
        for folder in (Path("a"), Path("b")):
            progress.ends(Outcome("s", folder=folder))
    lines = file.getvalue().splitlines()
    assert lines[0] == "Demo, 2 runs: 2 scenes"
    assert lines[1].startswith("compiling, once, about ")
    assert lines[2:] == ["Demo, 2 runs: 100%, 2/2 scenes"]
    quiet = io.StringIO()
    with TerminalProgress(Console(file=quiet), quiet=True) as progress:
        progress.begin("Demo", 1, 1)
        progress.ends(Outcome("s", folder=Path("a")))
    assert quiet.getvalue() == ""


VELOCITY = MetricKey("velocity", "all", "mean", "m/s")
MOTA = MetricKey("tracking", "all", "MOTA", lower_is_better=False)
NAN = float("nan")


def difference(key: MetricKey, before: float, after: float, half: float) -> PairedDifference:
    change = after - before
    return PairedDifference(key, before, after, change - half, change + half, 6)


def comparison(rows: dict[str, tuple[PairedDifference, ...]], scenes: int = 6) -> Any:
    def run(title: str) -> Any:
        names = tuple(f"s{k}" for k in range(scenes))
        return SimpleNamespace(
            title=title, finished=names, has_truth=True, given_truth=title == "ground_truth"
        )

    parts = [RunDifferences(title, "zero", scenes, found) for title, found in rows.items()]
    return SimpleNamespace(runs=[run("zero"), *map(run, rows)], differences=parts)


def test_the_conclusion_tells_of_the_significant_run_not_of_the_largest_change() -> None:
    found = {
        "far": (difference(VELOCITY, 1.0, 0.2, 0.9),),  # larger, but may be chance
        "sure": (difference(VELOCITY, 1.0, 0.5, 0.1), difference(MOTA, 0.6, 0.5, 0.05)),
        "ground_truth": (difference(VELOCITY, 1.0, 0.0, 0.1),),
    }
    told = conclusion(comparison(found))
    assert told == (
        "sure against zero: velocity error 1.000 -> 0.500 m/s, significantly better; "
        "MOTA 0.600 -> 0.500, significantly worse (6 scenes)."
    )
    del found["sure"]
    flow = difference(MetricKey("flow", "dynamic", "RMSE", "m/s"), 8.0, 1.0, 2.0)
    shown = conclusion(comparison({"far": (*found["far"], flow)}))
    assert "not significant; flow RMSE of moving cells 8.000 -> 1.000 m/s, signif" in shown
    assert "0.200 m/s, not significant (6 scenes)" in conclusion(comparison(found))
    one = {"far": (replace(found["far"][0], low=NAN, high=NAN),)}
    assert "of unknown significance (1 scene)" in conclusion(comparison(one, scenes=1))


def test_without_truth_the_conclusion_is_about_that() -> None:
    runs = [
        SimpleNamespace(title=title, finished=("a",), has_truth=False, given_truth=False)
        for title in ("zero", "icp")
    ]
    told = conclusion(SimpleNamespace(runs=runs, differences=[]))  # type: ignore[arg-type]
    assert told == "1 scene without truth: tracked, not scored."
    error = PairedDifference(ERROR, 2.0, 0.3, -1.9, -1.5, 8)
    judged = [RunDifferences("icp", "zero", 8, (error,))]
    told = conclusion(SimpleNamespace(runs=runs, differences=judged))  # type: ignore[arg-type]
    assert "icp against zero: flow error without labels 2.000 -> 0.300 m/s, significantly" in told
