"""A page on tracks of any kind: what a report says of runs, without their player and settings."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from mottrack._version import __version__
from mottrack.core.storage import write_text
from mottrack.eval.tracked_scenes import TrackedScenes
from mottrack.report.evaluations import FlowTables, Player, tracked_sections

STYLES = ("base.css", "parts.css")
SCRIPTS = ("theme.js", "tips.js", "start.js")
_TEMPLATE = "tracked.html.j2"


def write_tracked_page(known: dict[str, TrackedScenes], path: Path) -> None:
    """Write curves, slices, calibration and probable label errors of tracks as one HTML file.

    Args:
        known: name to scenes with tracks and truth, at least one.
        path: of the file; replaced at once or not at all.
    """
    environment = Environment(
        loader=PackageLoader("mottrack.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    folder = files("mottrack.report").joinpath("templates")
    content = {
        **tracked_sections(known, FlowTables(), Player()),
        "version": __version__,
        "scenes": max(len(scenes.results) for scenes in known.values()),
        "style": "\n".join(folder.joinpath("css", name).read_text() for name in STYLES),
        "script": "\n".join(folder.joinpath("js", name).read_text() for name in SCRIPTS),
    }
    write_text(path, environment.get_template(_TEMPLATE).render(**content))
