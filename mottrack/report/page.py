"""Fills the report's template with the figures of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined

import mottrack
from mottrack.core.storage import write_text
from mottrack.report.analysis import Analysis
from mottrack.report.differences import difference_groups
from mottrack.report.films import SceneSelection, contents, programme
from mottrack.report.measures import FLOW, GLOSSARY, INTERVAL, TIMING, TRACKING, VELOCITY
from mottrack.report.ranking import ReportRun
from mottrack.report.summary import cards, headlines
from mottrack.report.tables import flow_blocks, gain_rows, tracking_blocks, velocity_blocks
from mottrack.report.timing import BUDGET_MS, Timing, stages_of, time_bars, time_rows
from mottrack.runs.comparison import Comparison, ScoredRun

TEMPLATE = "report.html.j2"
STYLES = ("base.css", "parts.css", "player.css")
SCRIPTS = (
    "theme.js",
    "tips.js",
    "chart.js",
    "plots.js",
    "film_data.js",
    "film_colour.js",
    "film_draw.js",
    "film_errors.js",
    "player.js",
    "main.js",
)
MAX_MB = 15.0


def write_report(comparison: Comparison, path: Path, *, max_mb: float = MAX_MB) -> None:
    """Writes one self-contained HTML file.

    Args:
        comparison: at least one run with a finished scene.
        path: of the HTML file; replaced at once or not at all.
        max_mb: about how large the file may get: scenes beyond that are listed, not shown moving.
    """
    environment = Environment(
        loader=PackageLoader("mottrack.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"sort_keys": False}  # tables have an order
    runs = [run for run in comparison.runs if run.report.finished]
    entrants = [ReportRun(index, run) for index, run in enumerate(runs)]
    analyses = [Analysis.of(run) for run in runs]
    shown = programme(entrants, analyses, max_mb * 1e6)
    content = _content(entrants, analyses, comparison) | _moving(shown, entrants, analyses)
    page = environment.get_template(TEMPLATE).render(**content, **_sources())
    write_text(path, page)


def _content(
    entrants: Sequence[ReportRun], analyses: Sequence[Analysis], comparison: Comparison
) -> dict[str, Any]:
    groups = difference_groups(comparison.differences, entrants)
    answers = cards(entrants, analyses, comparison.differences)
    return {
        "name": entrants[0].run.experiment.settings.name if entrants else "run",
        "version": mottrack.__version__,
        "entrants": entrants,
        "scene_count": len({s for e in entrants for s in e.run.report.finished}),
        "failed": comparison.failed,
        "has_truth": any(e.has_truth for e in entrants),
        "cards": answers,
        "headlines": headlines(answers, groups),
        "common_scenes": max((d.scenes for d in comparison.differences), default=0),
        "difference_groups": groups,
        "tracking": tracking_blocks(entrants),
        "velocity": velocity_blocks(entrants),
        "flow": flow_blocks(entrants),
        **_times(entrants, [a.timing for a in analyses]),
        "gains": gain_rows(entrants, [a.anatomy for a in analyses]),
        "has_curves": any(a.curves for a in analyses),
        "measures": {"tracking": TRACKING, "velocity": VELOCITY, "flow": FLOW, "timing": TIMING},
        "glossary": GLOSSARY,
        "interval": INTERVAL,
        "configs": {e.title: _yaml(e.run) for e in entrants},
    }


def _times(entrants: Sequence[ReportRun], timings: Sequence[Timing | None]) -> dict[str, Any]:
    return {
        "budget_ms": BUDGET_MS,
        "stages": stages_of(timings),
        "time_bars": time_bars(entrants, timings),
        "time_rows": time_rows(entrants, timings),
    }


def _moving(
    shown: SceneSelection, entrants: Sequence[ReportRun], analyses: Sequence[Analysis]
) -> dict[str, Any]:
    return {
        "programme": shown,
        "data": {
            "runs": [
                {
                    "title": e.title,
                    "oracle": e.oracle,
                    "truth": {k: v.clear.truth for k, v in e.run.scores.classes.items()},
                    **a.as_dict(),
                }
                for e, a in zip(entrants, analyses, strict=True)
            ],
            "budget_ms": BUDGET_MS,
            "films": contents(shown.reels, entrants),
        },
    }


def _sources() -> dict[str, str]:
    folder = files("mottrack.report").joinpath("templates")
    return {
        "style": "\n".join(folder.joinpath("css", name).read_text() for name in STYLES),
        "script": "\n".join(folder.joinpath("js", name).read_text() for name in SCRIPTS),
    }


def _yaml(run: ScoredRun) -> str:
    return yaml.safe_dump(run.experiment.resolved(), sort_keys=False, allow_unicode=True)
