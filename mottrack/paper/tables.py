"""Our values beside those of the paper, as tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from mottrack.eval.paired import Sampled, t_interval
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.paper.claims import Finding
from mottrack.paper.plan import ABLATIONS
from mottrack.paper.published import LABELS, Published
from mottrack.paper.results import StudyResult

ABSENT, LEFT_OUT = "not measured", "–"
LARGE = 20.0
"""From here on one decimal: three would pretend a precision that times and errors do not have."""
NOTHING = "these scenes have no such object or cell"
NO_WEIGHTS = "there are no weights"
NAN = float("nan")


@dataclass(frozen=True)
class Measured:
    """One cell: our value with its interval, and the value of the paper."""

    variant: str
    heading: str
    value: float
    half_width: float
    """Of the 95 % interval; NaN where there is none."""
    printed: float | None
    """By the paper."""
    scenes: int
    digits: int
    """Printed digits of the paper after the decimal point."""
    left_out: bool = False
    """Whether the paper prints nothing here on purpose, and neither do we."""

    @property
    def absent(self) -> bool:
        """Whether a value is missing."""
        return self.value != self.value and not self.left_out

    @property
    def ours(self) -> str:
        """Text of our value."""
        if self.left_out:
            return LEFT_OUT
        if self.absent:
            return ABSENT
        if self.half_width != self.half_width:
            return number(self.value)
        return f"{number(self.value)} ± {number(self.half_width)}"

    @property
    def papers(self) -> str:
        """Text of the value of the paper; empty where it prints none."""
        return "" if self.printed is None else f"(paper {self.printed:.{self.digits}f})"

    @property
    def text(self) -> str:
        """Both in one cell."""
        return " ".join(filter(None, (self.ours, self.papers)))


class TableRow(NamedTuple):
    """A row of a table as it is printed."""

    name: str
    cells: tuple[Measured, ...]


def number(value: float, sign: str = "") -> str:
    """Print three decimals, or one for large values; with its sign if ``sign`` is ``"+"``."""
    return f"{value:{sign}.{3 if abs(value) < LARGE else 1}f}"


def measure(table: Published, result: StudyResult) -> list[list[Measured]]:
    """Return one list of cells per method, with a cell per metric."""
    return [
        [
            _measured(variant, column, table, result.sampled(variant, key))
            for column, (_, key) in enumerate(table.columns)
        ]
        for variant in _present(table, result)
    ]


def table_rows(table: Published, result: StudyResult) -> list[TableRow]:
    """Return the rows of a table: methods, or metrics where the paper has methods in columns."""
    lines = measure(table, result)
    if table.methods_in_rows:
        return [TableRow(LABELS[line[0].variant], tuple(line)) for line in lines]
    return [TableRow(cells[0].heading, cells) for cells in zip(*lines, strict=True)]


def paper_table(table: Published, result: StudyResult) -> TextTable:
    """Return a table with our values and those of the paper, to read."""
    rows = table_rows(table, result)
    if table.methods_in_rows:
        headings = ["method", *(cell.heading for cell in rows[0].cells)]
    else:
        headings = ["metric", *(LABELS[cell.variant] for cell in rows[0].cells)]
    return TextTable(
        f"table_{table.number}_{result.study.dataset}",
        table.heading,
        tuple(Column(name) for name in headings),
        tuple((row.name, *(cell.text for cell in row.cells)) for row in rows),
        " ".join(filter(None, (_scenes(result), table.note, _absences(table, result)))),
    )


def _scenes(result: StudyResult) -> str:
    count = len(result.sampling.scenes)
    if count == 1:
        return f"One scene of {result.study.title}, so there are no intervals."
    return f"{count} scenes of {result.study.title}; ± is a 95 % interval."


def _absences(table: Published, result: StudyResult) -> str:
    """Say which runs and metrics are missing, and why."""
    reasons: dict[str, list[str]] = {}
    for variant in table.variants:
        if variant not in result.sampling.figures:
            reasons.setdefault(_reason(variant, result), []).append(LABELS[variant])
    for line in measure(table, result):
        for cell in line:
            known = cell.variant in result.sampling.figures
            if cell.absent and known and cell.heading not in reasons.get(NOTHING, ()):
                reasons.setdefault(NOTHING, []).append(cell.heading)
    return " ".join(f"Not measured: {'; '.join(who)}: {why}." for why, who in reasons.items())


def _reason(variant: str, result: StudyResult) -> str:
    """Say why a run is missing."""
    if variant in result.study.absent:
        return result.study.absent[variant]
    failed = [why for scene, why in result.failed.items() if scene.variant == variant]
    if failed:
        return f"failed: {failed[0]}"
    return NO_WEIGHTS if variant in ABLATIONS else "not run"


def number_table(table: Published, result: StudyResult) -> TextTable:
    """Return the same as numbers, one row per cell, for programs."""
    columns = ("method", "metric", "value", "low", "high", "paper", "scenes")
    rows: list[tuple[Cell, ...]] = []
    for line in measure(table, result):
        for cell in line:
            ends = (cell.value - cell.half_width, cell.value + cell.half_width)
            names = (LABELS[cell.variant], cell.heading)
            rows.append((*names, cell.value, *ends, cell.printed, cell.scenes))
    name = f"table_{table.number}_{result.study.dataset}"
    return TextTable(name, table.title, tuple(Column(c) for c in columns), tuple(rows))


_DIFFERENCE = tuple(Column(name, signed=True) for name in ("difference", "low", "high"))


def claim_table(findings: Sequence[Finding], dataset: str) -> TextTable:
    """Return every claim with its verdict."""
    first = (Column("claim"), Column("paper"), Column("ours"))
    columns = (*first, *_DIFFERENCE, Column("verdict"), Column("source"))
    rows = tuple(_claim_row(finding) for finding in findings)
    return TextTable(f"claims_{dataset}", "Claims of the paper", columns, rows)


def beyond_table(tables: Sequence[Published], results: Sequence[StudyResult]) -> TextTable:
    """Return rows that the paper does not have, compared with the first row of the same table."""
    first = (Column(name) for name in ("table", "method", "against", "metric", "value"))
    columns = (*first, *_DIFFERENCE, Column("verdict"))
    rows = tuple(row for t, r in zip(tables, results, strict=True) for row in _beyond(t, r))
    return TextTable("beyond_the_paper", "Beyond the paper", columns, rows)


def _beyond(table: Published, result: StudyResult) -> Iterator[tuple[Cell, ...]]:
    first = table.variants[0]
    for variant in [name for name in table.extra if name != first]:
        for heading, key in table.columns:
            found = result.paired(first, variant, key)
            if found is not None:
                verdict = {True: "better", False: "worse", None: "not significant"}[found.better]
                names = (table.number, LABELS[variant], LABELS[first], heading)
                yield (*names, found.value, found.difference, found.low, found.high, verdict)


def _claim_row(finding: Finding) -> tuple[Cell, ...]:
    claim, found = finding.claim, finding.paired
    if found is None:
        return (claim.text, claim.printed, ABSENT, None, None, None, finding.verdict, claim.source)
    ours = f"{number(found.value)}, {number(found.baseline)}"
    ends = (found.difference, found.low, found.high)
    return (claim.text, claim.printed, ours, *ends, finding.verdict, claim.source)


def _present(table: Published, result: StudyResult) -> list[str]:
    """Return the rows of the paper, measured or not, and our rows that were measured."""
    return [*table.values, *(v for v in table.extra if v in result.sampling.figures)]


def _measured(variant: str, column: int, table: Published, sampled: Sampled | None) -> Measured:
    heading, printed = table.columns[column].heading, table.printed(variant, column)
    left_out = printed is None and variant in table.values
    if sampled is None or left_out:
        return Measured(variant, heading, NAN, NAN, printed, 0, table.digits, left_out)
    scenes = int(sampled.present.sum())
    _, high = t_interval(sampled.value, sampled.draws, scenes)
    half = high - sampled.value
    return Measured(variant, heading, sampled.value, half, printed, scenes, table.digits)
