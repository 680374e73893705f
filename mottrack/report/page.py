"""Rendering of the report: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from mottrack._version import __version__
from mottrack.core.storage import write_text
from mottrack.eval.metric_info import FLOW, TRACKING, VELOCITY, MetricInfo
from mottrack.formats.html_page import page_templates
from mottrack.report.analysis import Analysis
from mottrack.report.differences import difference_groups
from mottrack.report.evaluations import evaluation_sections
from mottrack.report.player_scenes import SceneSelection, contents, select_scenes
from mottrack.report.ranking import ReportRun, Verdicts, report_runs
from mottrack.report.summary import findings, metric_cards
from mottrack.report.tables import flow_blocks, gain_rows, tracking_blocks, velocity_blocks
from mottrack.report.timing import (
    TIMING,
    Timing,
    budget_ms,
    stages_of,
    time_rows,
    widest_ms,
)
from mottrack.runs.comparison import Comparison
from mottrack.runs.comparison_tables import settings_table
from mottrack.runs.conclusion import conclusion
from mottrack.runs.criteria import unmet
from mottrack.runs.terminal import in_common
from mottrack.runs.velocity_bench import plain_words

TEMPLATE = "report.html.j2"
STYLES = ("base.css", "parts.css", "player.css")
SCRIPTS = (
    "theme.js",
    "tips.js",
    "chart.js",
    "plots.js",
    "recording.js",
    "flow_colour.js",
    "bev_view.js",
    "error_panel.js",
    "player.js",
    "deep_link.js",
    "main.js",
)
MAX_MB = 15.0
"""Default size of the page: about six scenes of the embedded world, quick to open and to send."""
INTERVAL = MetricInfo(
    "interval",
    "95 % interval",
    "Confidence interval of the paired difference: scenes are resampled with replacement, the same "
    "ones for both runs, and Student's t with the number of scenes is applied. A difference whose "
    "interval excludes zero is significant. Few scenes give wide intervals.",
)
ORACLE = MetricInfo(
    "oracle",
    "oracle",
    "A run that is given the true flow: the upper bound for a flow source. It is not ranked.",
)


def write_report(comparison: Comparison, path: Path, *, max_mb: float = MAX_MB) -> None:
    """Write the report of a comparison.

    Args:
        comparison: at least one run with a finished scene.
        path: of the HTML file; replaced at once or not at all.
        max_mb: approximate size up to which scenes are included; the others are listed by name.
    """
    runs = report_runs([run for run in comparison.runs if run.report.finished])
    analyses = [Analysis.of(run.scored) for run in runs]
    verdicts = Verdicts.of(comparison.differences)
    selection = select_scenes(runs, analyses, max_mb * 1e6)
    content = {
        **_summary(runs, analyses, comparison, verdicts),
        **_tables(runs, analyses, verdicts),
        **_times(runs, [a.timing for a in analyses]),
        **_player(runs, analyses, selection),
        **evaluation_sections(runs, [packed.scene for packed in selection.scenes]),
        **_sources(),
    }
    write_text(path, page_templates("mottrack.report").get_template(TEMPLATE).render(**content))


def _summary(
    runs: Sequence[ReportRun],
    analyses: Sequence[Analysis],
    comparison: Comparison,
    verdicts: Verdicts,
) -> dict[str, Any]:
    has_truth = any(run.has_truth for run in runs)
    groups = difference_groups(comparison.differences, runs) if has_truth else []
    return {
        "name": _name(runs),
        "about": in_common([run.scored for run in runs]),
        "version": __version__,
        "runs": runs,
        "failed": comparison.failed,
        "concerns": {text: run.title for run in reversed(runs) for text in run.scored.concerns},
        "has_truth": has_truth,
        "clusters": any(run.clusters for run in runs),
        "flow_value": _flow_value(comparison) if has_truth else [],
        "cards": metric_cards(runs, analyses, verdicts),
        "conclusion": conclusion(comparison),
        "findings": findings(groups),
        "common_scenes": max((d.scenes for d in comparison.differences), default=0),
        "difference_groups": [group for group in groups if group.significant],
        "other_groups": [group for group in groups if not group.significant],
    }


def _flow_value(comparison: Comparison) -> list[str]:
    """Say what flow was worth, and which criteria of the experiment are not met."""
    return [*plain_words(comparison.flow_values), *unmet(comparison.judged)]


def _name(runs: Sequence[ReportRun]) -> str:
    """Return the name that the runs share; runs of different days have none."""
    names = {run.scored.experiment.name for run in runs}
    return names.pop() if len(names) == 1 else " and ".join(run.title for run in runs) or "run"


def _tables(
    runs: Sequence[ReportRun], analyses: Sequence[Analysis], verdicts: Verdicts
) -> dict[str, Any]:
    has_truth = any(run.has_truth for run in runs)
    return {
        "tracking": tracking_blocks(runs, verdicts),
        "velocity": velocity_blocks(runs, verdicts),
        "flow": flow_blocks(runs, verdicts) if has_truth else [],
        "gains": gain_rows(runs, [a.classes.error_classes for a in analyses]),
        "has_curves": any(a.classes.curves for a in analyses),
        "metrics": {"tracking": TRACKING, "velocity": VELOCITY, "flow": FLOW, "timing": TIMING},
        "glossary": (*TRACKING, *VELOCITY, *FLOW, TIMING, INTERVAL, ORACLE),
        "interval": INTERVAL,
        "settings": settings_table([run.scored for run in runs]).texts() if runs[1:] else [],
        "config": yaml.safe_dump(
            runs[0].scored.experiment.resolved() if runs else {},
            sort_keys=False,
            allow_unicode=True,
        ),
    }


def _times(runs: Sequence[ReportRun], timings: Sequence[Timing | None]) -> dict[str, Any]:
    return {
        "budget_ms": budget_ms(timings),
        "stages": stages_of(timings),
        "timings": [(r.title, t) for r, t in zip(runs, timings, strict=True) if t is not None],
        "widest_ms": widest_ms(timings),
        "time_rows": time_rows(runs, timings),
    }


def _player(
    runs: Sequence[ReportRun], analyses: Sequence[Analysis], selection: SceneSelection
) -> dict[str, Any]:
    plots = [
        {
            "title": run.title,
            "oracle": run.oracle,
            "colour": run.colour,
            "truth": {k: v.clear.truth for k, v in run.scored.scores.classes.items()},
            **analysis.as_dict(),
        }
        for run, analysis in zip(runs, analyses, strict=True)
    ]
    return {"selection": selection, "data": {"runs": plots, "scenes": contents(selection, runs)}}


def _sources() -> dict[str, str]:
    folder = files("mottrack.report").joinpath("templates")
    return {
        "style": "\n".join(
            folder.joinpath("css", name).read_text(encoding="utf-8") for name in STYLES
        ),
        "script": "\n".join(
            folder.joinpath("js", name).read_text(encoding="utf-8") for name in SCRIPTS
        ),
    }
