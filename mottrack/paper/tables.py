"""Our tables beside the paper's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mottrack.eval.paired import Sampled, t_interval
from mottrack.formats.text_table import Cell, Column, TextTable
from mottrack.paper.ablations import ABLATIONS
from mottrack.paper.claims import Finding
from mottrack.paper.published import LABELS, Published
from mottrack.paper.results import StudyResult

ABSENT, LEFT_OUT = "not measured", "–"
LARGE = 20.0
NOTHING = "there is nothing of the kind in these scenes"
NO_WEIGHTS = "there are no weights"


@dataclass(frozen=True)
class Measured:
    """One cell: ours with its interval, and the paper's."""

    variant: str
    heading: str
    value: float
    reach: float
    """Half the width of the 95 % interval; NaN where there is none."""
    printed: float | None
    scenes: int
    digits: int
    """Of what the paper prints, behind the point."""
    left_out: bool = False
    """Whether the paper prints nothing here, on purpose: nor do we."""

    @property
    def absent(self) -> bool:
        """Whether there should be a figure, and is none."""
        return self.value != self.value and not self.left_out

    @property
    def text(self) -> str:
        """As people read it."""
        if self.left_out:
            return LEFT_OUT
        if self.absent:
            ours = ABSENT
        elif self.reach != self.reach:
            ours = number(self.value)
        else:
            ours = f"{number(self.value)} ± {number(self.reach)}"
        return ours if self.printed is None else f"{ours} (paper {self.printed:.{self.digits}f})"


def number(value: float, sign: str = "") -> str:
    """Three digits behind the point, or one for what is large; with its sign for ``+``."""
    return f"{value:{sign}.{3 if abs(value) < LARGE else 1}f}"


def measure(table: Published, result: StudyResult) -> list[list[Measured]]:
    """A line a method, a cell a figure."""
    return [
        [
            _measured(variant, column, table, result.sampled(variant, key))
            for column, (_, key) in enumerate(table.figures)
        ]
        for variant in _present(table, result)
    ]


def paper_table(table: Published, result: StudyResult) -> TextTable:
    """Ours and the paper's in one cell, for people."""
    lines = measure(table, result)
    names = [LABELS[line[0].variant] for line in lines]
    headings = [heading for heading, _ in table.figures]
    rows: list[tuple[Cell, ...]] = [
        (name, *(cell.text for cell in line)) for name, line in zip(names, lines, strict=True)
    ]
    columns = ("method", *headings)
    if not table.upright:
        turned = zip(*lines, strict=True)
        rows = [
            (heading, *(cell.text for cell in cells))
            for heading, cells in zip(headings, turned, strict=True)
        ]
        columns = ("figure", *names)
    title = f"Table {table.number}: {table.title}"
    return TextTable(
        f"table_{table.number}_{result.study.dataset}",
        title,
        tuple(Column(name) for name in columns),
        tuple(rows),
        " ".join(filter(None, (_scenes(result), table.note, _absences(table, result)))),
    )


def _scenes(result: StudyResult) -> str:
    count = len(result.sampling.scenes)
    if count == 1:
        return f"One scene of {result.study.title}, so there are no intervals."
    return f"{count} scenes of {result.study.title}; ± is a 95 % interval."


def _absences(table: Published, result: StudyResult) -> str:
    """Why runs and figures are missing, in sentences."""
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
    """Why a run is missing."""
    if variant in result.study.absent:
        return result.study.absent[variant]
    failed = [why for name, why in result.failed.items() if name.startswith(f"{variant}/")]
    if failed:
        return f"failed: {failed[0]}"
    return NO_WEIGHTS if variant in ABLATIONS else "not run"


def number_table(table: Published, result: StudyResult) -> TextTable:
    """The same as numbers, one line a cell, for programs."""
    columns = ("method", "figure", "value", "low", "high", "paper", "scenes")
    rows: list[tuple[Cell, ...]] = []
    for line in measure(table, result):
        for cell in line:
            ends = (cell.value - cell.reach, cell.value + cell.reach)
            names = (LABELS[cell.variant], cell.heading)
            rows.append((*names, cell.value, *ends, cell.printed, cell.scenes))
    name = f"table_{table.number}_{result.study.dataset}"
    return TextTable(name, table.title, tuple(Column(c) for c in columns), tuple(rows))


def claim_table(findings: Sequence[Finding], dataset: str) -> TextTable:
    """Every claim with its verdict."""
    columns = (
        Column("claim"),
        Column("paper"),
        Column("ours"),
        Column("difference", signed=True),
        Column("low", signed=True),
        Column("high", signed=True),
        Column("verdict"),
        Column("source"),
    )
    rows = tuple(_claim_row(finding) for finding in findings)
    return TextTable(f"claims_{dataset}", "The paper's claims", columns, rows)


def beyond_table(tables: Sequence[Published], results: Sequence[StudyResult]) -> TextTable:
    """Rows that the paper has not, against the first row of the same table."""
    columns = (
        *(Column(name) for name in ("table", "method", "against", "figure", "value")),
        Column("difference", signed=True),
        Column("low", signed=True),
        Column("high", signed=True),
        Column("real"),
    )
    rows = tuple(row for t, r in zip(tables, results, strict=True) for row in _beyond(t, r))
    return TextTable("beyond_the_paper", "Beyond the paper", columns, rows)


def _beyond(table: Published, result: StudyResult) -> Iterator[tuple[Cell, ...]]:
    first = next(iter(table.values))
    for variant in table.extra:
        for heading, key in table.figures:
            found = result.paired(first, variant, key)
            if found is not None:
                real = {True: "better", False: "worse", None: "not shown"}[found.better]
                names = (table.number, LABELS[variant], LABELS[first], heading)
                yield (*names, found.value, found.difference, found.low, found.high, real)


def _claim_row(finding: Finding) -> tuple[Cell, ...]:
    claim, found = finding.claim, finding.paired
    if found is None:
        return (claim.text, claim.printed, ABSENT, None, None, None, finding.verdict, claim.source)
    ours = f"{number(found.value)}, {number(found.baseline)}"
    ends = (found.difference, found.low, found.high)
    return (claim.text, claim.printed, ours, *ends, finding.verdict, claim.source)


def _present(table: Published, result: StudyResult) -> list[str]:
    """The paper's rows, measured or not, and those of ours that were."""
    extra = [v for v in (*table.extra, *_alike(table)) if v in result.sampling.figures]
    return [*table.values, *extra]


def _alike(table: Published) -> tuple[str, ...]:
    """PWCNet trained as briefly as its rivals, where there are such weights."""
    return tuple(v for v in ABLATIONS if v not in table.values) if table.number == "II" else ()


def _measured(variant: str, column: int, table: Published, sampled: Sampled | None) -> Measured:
    heading, printed = table.figures[column][0], table.printed(variant, column)
    left_out = printed is None and variant in table.values
    if sampled is None or left_out:
        nothing = float("nan")
        return Measured(variant, heading, nothing, nothing, printed, 0, table.digits, left_out)
    scenes = int(sampled.present.sum())
    _, high = t_interval(sampled.value, sampled.draws, scenes)
    reach = high - sampled.value
    return Measured(variant, heading, sampled.value, reach, printed, scenes, table.digits)
