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
from mottrack.report.ranking import ReportRun
from mottrack.report.summary import headlines, metric_cards
from mottrack.report.tables import flow_blocks, gain_rows, tracking_blocks, velocity_blocks
from mottrack.report.timing import BUDGET_MS, TIMING, Timing, stages_of, time_rows, widest_ms
from mottrack.runs.comparison import Comparison
from mottrack.runs.comparison_tables import settings_table
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
    finished = [run for run in comparison.runs if run.report.finished]
    runs = [ReportRun(index, run) for index, run in enumerate(finished)]
    analyses = [Analysis.of(run) for run in finished]
    selection = select_scenes(runs, analyses, max_mb * 1e6)
    content = {
        **_summary(runs, analyses, comparison),
        **_tables(runs, analyses),
        **_times(runs, [a.timing for a in analyses]),
        **_player(runs, analyses, selection),
        **evaluation_sections(runs, [packed.scene for packed in selection.scenes]),
        **_sources(),
    }
    write_text(path, page_templates("mottrack.report").get_template(TEMPLATE).render(**content))


def _summary(
    runs: Sequence[ReportRun], analyses: Sequence[Analysis], comparison: Comparison
) -> dict[str, Any]:
    groups = difference_groups(comparison.differences, runs)
    cards = metric_cards(runs, analyses, comparison.differences)
    return {
        "name": _name(runs),
        "version": __version__,
        "runs": runs,
        "scene_count": len({s for run in runs for s in run.scored.report.finished}),
        "failed": comparison.failed,
        "concerns": {text: run.title for run in reversed(runs) for text in run.scored.concerns},
        "has_truth": any(run.has_truth for run in runs),
        "flow_value": plain_words(comparison.flow_values),
        "cards": cards,
        "headlines": headlines(cards, groups),
        "common_scenes": max((d.scenes for d in comparison.differences), default=0),
        "difference_groups": groups,
    }


def _name(runs: Sequence[ReportRun]) -> str:
    """Return the name that the runs share; runs of different days have none."""
    names = {run.scored.experiment.settings.name for run in runs}
    return names.pop() if len(names) == 1 else " and ".join(run.title for run in runs) or "run"


def _tables(runs: Sequence[ReportRun], analyses: Sequence[Analysis]) -> dict[str, Any]:
    return {
        "tracking": tracking_blocks(runs),
        "velocity": velocity_blocks(runs),
        "flow": flow_blocks(runs),
        "gains": gain_rows(runs, [a.classes.error_classes for a in analyses]),
        "has_curves": any(a.classes.curves for a in analyses),
        "metrics": {"tracking": TRACKING, "velocity": VELOCITY, "flow": FLOW, "timing": TIMING},
        "glossary": (*TRACKING, *VELOCITY, *FLOW, TIMING, INTERVAL, ORACLE),
        "interval": INTERVAL,
        "settings": settings_table([run.scored for run in runs]).texts() if runs[1:] else [],
        "configs": {
            run.title: yaml.safe_dump(
                run.scored.experiment.resolved(), sort_keys=False, allow_unicode=True
            )
            for run in runs
        },
    }


def _times(runs: Sequence[ReportRun], timings: Sequence[Timing | None]) -> dict[str, Any]:
    return {
        "budget_ms": BUDGET_MS,
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
