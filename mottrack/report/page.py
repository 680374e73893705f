"""Fills the report's template with the figures of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined

import mottrack
from mottrack.core.storage import write_text
from mottrack.pipeline.comparison import Comparison, ScoredRun, velocity_rows
from mottrack.pipeline.terminal import title
from mottrack.report.figures import bev_grid, velocity_bars

TEMPLATE = "report.html.j2"


def write_report(comparison: Comparison, path: Path) -> None:
    """Writes one self-contained HTML file.

    Args:
        comparison: at least one run with a finished scene.
        path: of the HTML file; replaced at once or not at all.
    """
    environment = Environment(
        loader=PackageLoader("mottrack.report"), autoescape=True, undefined=StrictUndefined
    )
    environment.filters["number"] = _number
    runs = [run for run in comparison.runs if run.report.finished]
    page = environment.get_template(TEMPLATE).render(**_content(runs, comparison))
    write_text(path, page)


def _content(runs: Sequence[ScoredRun], comparison: Comparison) -> dict[str, Any]:
    scenes = list(dict.fromkeys(scene for run in runs for scene in run.report.finished))
    pictures = {scene: bev_grid(runs, scene) for scene in scenes[:MOST_PICTURES]}
    return {
        "name": runs[0].experiment.settings.name if runs else "run",
        "version": mottrack.__version__,
        "titles": [title(run) for run in runs],
        "runs": runs,
        "scenes": scenes,
        "pictures": {scene: url for scene, url in pictures.items() if url},
        "velocity_rows": velocity_rows(runs),
        "velocity_bars": velocity_bars(runs) if runs else "",
        "configs": {title(run): _yaml(run) for run in runs},
        "failed": comparison.failed,
    }


MOST_PICTURES = 6


def _yaml(run: ScoredRun) -> str:
    return yaml.safe_dump(run.experiment.resolved(), sort_keys=False, allow_unicode=True)


def _number(value: float | None, digits: int = 3) -> str:
    if value is None or value != value:
        return "–"
    return str(value) if isinstance(value, int) else f"{value:.{digits}f}"
