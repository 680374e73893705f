"""Output of a reproduction: HTML page, Markdown, tables as CSV and LaTeX, claims.json, figures."""

from __future__ import annotations

import base64
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from mottrack._version import __version__
from mottrack.core.storage import write_text
from mottrack.formats.html_page import page_templates
from mottrack.formats.text_table import TextTable, to_csv, to_latex, to_markdown
from mottrack.paper.claims import MEANING, Finding
from mottrack.paper.figures import Picture, draw_figures
from mottrack.paper.plan import ABLATIONS, Request, ablation_weights
from mottrack.paper.published import TABLES, Published
from mottrack.paper.results import Results, StudyResult
from mottrack.paper.tables import (
    TableRow,
    beyond_table,
    claim_table,
    measure,
    number,
    number_table,
    paper_table,
    table_rows,
)
from mottrack.runs.comparison_tables import METHOD
from mottrack.runs.criteria import MEANING as CRITERIA_MEANING
from mottrack.runs.criteria import Judged, criteria_table, unmet
from mottrack.runs.velocity_bench import bench_table, plain_words

STYLES = ("base.css", "parts.css")
SOURCE = "PillarFlow: End-to-end Birds-eye-view Flow Estimation for Autonomous Driving, IROS 2020"


@dataclass(frozen=True)
class Section:
    """One table and the claims drawn from it."""

    table: Published
    result: StudyResult
    findings: list[Finding]

    @property
    def shown(self) -> TextTable:
        """Our values and those of the paper, to read."""
        return paper_table(self.table, self.result)

    @property
    def rows(self) -> list[TableRow]:
        """The same as cells."""
        return table_rows(self.table, self.result)


@dataclass(frozen=True)
class Bench:
    """What flow was worth in one study, and what was claimed of it before it ran."""

    result: StudyResult
    title: str

    @property
    def table(self) -> TextTable:
        """Every metric of every source over common rows, then the shares of the headroom."""
        study = self.result.study
        name = f"flow_value_{study.name}_{study.dataset}"
        return replace(bench_table(self.result.bench), name=name, title=self.title)

    @property
    def words(self) -> list[str]:
        """The same of the best source, in three lines."""
        return plain_words(self.result.bench)

    @property
    def judged(self) -> list[Judged]:
        """The criteria with their verdicts."""
        return self.result.judged


@dataclass(frozen=True)
class Chapter:
    """The results on one data set."""

    dataset: str
    title: str
    sections: list[Section]
    findings: list[Finding]
    beyond: TextTable
    benches: list[Bench]
    """Of the studies of tracks that have a run without flow."""
    not_run: dict[str, str]
    """Title of a table to why nothing of it could be run."""
    left_out: dict[str, str]
    """Scenes that could not take part to the reason."""

    @property
    def in_words(self) -> list[Finding]:
        """The claims that the paper makes without a table."""
        return [finding for finding in self.findings if finding.claim.published is None]

    @property
    def judged(self) -> list[Judged]:
        """The criteria of all studies."""
        return [one for bench in self.benches for one in bench.judged]

    @property
    def failed(self) -> list[Finding]:
        """The claims of the paper that failed: reversed, or not reproduced."""
        failed = ("reversed", "not reproduced")
        return [finding for finding in self.findings if finding.verdict in failed]

    @property
    def counts(self) -> dict[str, int]:
        """Verdict to the number of claims that have it."""
        return _counts(self.findings)

    @property
    def summary(self) -> str:
        """The counts in two sentences."""
        favourable = [finding for finding in self.findings if finding.claim.favours_pillarflow]
        return (
            f"{len(self.findings)} claims: {_listed(self.counts)}. {len(favourable)} of them say "
            f"that PillarFlow is better: {_listed(_counts(favourable))}"
        )


def _counts(findings: Sequence[Finding]) -> dict[str, int]:
    found = Counter(finding.verdict for finding in findings)
    return {verdict: found[verdict] for verdict in MEANING if found[verdict]}


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {verdict}" for verdict, count in counts.items())


def write_paper(results: Results, request: Request) -> Iterator[str]:
    """Write all files into the folder of the request; yield lines for the terminal."""
    out = request.out
    chapters = [_chapter(results, name, title) for name, title in results.datasets.items()]
    pictures = draw_figures(results, out / "figures")
    for chapter in chapters:
        _write_tables(chapter, out / "tables")
    _write_claims(chapters, out / "claims.json")
    content = {
        "chapters": chapters,
        "pictures": pictures,
        "missing": missing_rows(request),
        "failed": results.failed,
        "quick": request.quick,
        "machines": results.machines,
        "method": METHOD,
        "meaning": MEANING,
        "criteria_meaning": CRITERIA_MEANING,
        "source": SOURCE,
        "version": __version__,
    }
    write_text(out / "paper.html", _page(content))
    write_text(out / "paper.md", _markdown(content))
    for chapter in chapters:
        yield from _told(chapter)
    yield from (f"failed: {name}: {reason}" for name, reason in results.failed.items())
    yield f"paper:  {out / 'paper.html'}"


def _told(chapter: Chapter) -> Iterator[str]:
    """Yield what the terminal shows of a chapter: counts, what flow was worth, what failed."""
    yield f"{chapter.title}: {chapter.summary}"
    for bench in chapter.benches:
        yield from (f"{bench.title}: {text}" for text in bench.words)
        yield from (f"{bench.title}: {text}" for text in unmet(bench.judged))
    yield from (f"{f.verdict}: {f.claim.text} (paper {f.claim.printed})" for f in chapter.failed)


def missing_rows(request: Request) -> list[str]:
    """Return, for every network of equal training without weights, the command that trains it."""
    return [
        f"make train-equal NETWORKS={name}"
        for name in ABLATIONS
        if ablation_weights(name, request.ablation) is None
    ]


def _chapter(results: Results, name: str, title: str) -> Chapter:
    pairs = [(table, results.find(name, table.study)) for table in TABLES]
    asked = [(table, study) for table, study in pairs if study is not None]
    not_run = {table.heading: study.study.reason for table, study in asked if study.study.reason}
    findings = results.findings(name)
    sections = [
        Section(table, study, [f for f in findings if f.claim.table == table.number])
        for table, study in asked
        if not study.study.reason and (table.values or measure(table, study))
    ]
    studies = [s for s in results.studies if s.study.dataset == name and s.bench]
    benches = [Bench(s, s.study.runs[0].settings.name) for s in studies]
    beyond = beyond_table([s.table for s in sections], [s.result for s in sections])
    left_out = {s: why for part in sections for s, why in part.result.study.left_out.items()}
    return Chapter(name, title, sections, findings, beyond, benches, not_run, left_out)


def _write_tables(chapter: Chapter, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    claims = claim_table(chapter.findings, chapter.dataset)
    for table in (*(section.shown for section in chapter.sections), claims):
        write_text(folder / f"{table.name}.tex", to_latex(table))
    numbers = (number_table(section.table, section.result) for section in chapter.sections)
    for table in (*numbers, claims):
        write_text(folder / f"{table.name}.csv", to_csv(table))
    write_text(folder / f"{chapter.beyond.name}_{chapter.dataset}.csv", to_csv(chapter.beyond))
    for bench in chapter.benches:
        write_text(folder / f"{bench.table.name}.csv", to_csv(bench.table))
    if chapter.judged:
        name = f"criteria_{chapter.dataset}.csv"
        write_text(folder / name, to_csv(criteria_table(chapter.judged)))


def _write_claims(chapters: Sequence[Chapter], path: Path) -> None:
    content = {
        "meaning": MEANING,
        "method": METHOD,
        "counts": {chapter.dataset: chapter.counts for chapter in chapters},
        "claims": [f.as_dict() for chapter in chapters for f in chapter.findings],
        "criteria": [
            {"dataset": chapter.dataset, "study": bench.title, **one.as_dict()}
            for chapter in chapters
            for bench in chapter.benches
            for one in bench.judged
        ],
    }
    write_text(path, json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n")


def _page(content: dict[str, Any]) -> str:
    environment = page_templates("mottrack.paper")
    environment.filters["data_url"] = _data_url
    environment.filters["number"] = number
    styles = files("mottrack.report").joinpath("templates", "css")
    style = "\n".join(styles.joinpath(name).read_text(encoding="utf-8") for name in STYLES)
    return environment.get_template("paper.html.j2").render(**content, style=style)


def _data_url(picture: Picture) -> str:
    return "data:image/png;base64," + base64.b64encode(picture.file.read_bytes()).decode()


def _markdown(content: dict[str, Any]) -> str:
    parts = [f"# Reproduction of the paper\n\n{content['source']}; mottrack {content['version']}."]
    if content["quick"]:
        parts.append("Quick run: few and short scenes, wide intervals.")
    for chapter in content["chapters"]:
        parts.append(f"## {chapter.title}\n\n{chapter.summary}. {METHOD}.")
        parts += [to_markdown(section.shown) for section in chapter.sections]
        parts.append(to_markdown(claim_table(chapter.findings, chapter.dataset)))
        for bench in chapter.benches:
            parts += [to_markdown(bench.table), "\n".join(bench.words)]
        if chapter.judged:
            parts.append(to_markdown(criteria_table(chapter.judged)))
        parts += [f"**{table}**: not measured: {why}." for table, why in chapter.not_run.items()]
        if chapter.beyond.rows:
            parts.append(to_markdown(chapter.beyond))
    parts += [f"![{p.caption}](figures/{p.file.name})\n\n{p.caption}" for p in content["pictures"]]
    parts += [f"Not measured without weights: `{command}`" for command in content["missing"]]
    return "\n\n".join(parts) + "\n"
