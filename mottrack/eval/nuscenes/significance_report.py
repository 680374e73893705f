"""Bootstrap results as files and as tables."""

import json
from pathlib import Path

from mottrack.core.storage import write_text
from mottrack.eval.nuscenes.bootstrap import (
    Difference,
    Interval,
    as_plain,
    compare,
    draw,
    intervals,
    profiles,
)
from mottrack.eval.nuscenes.boxes import Prepared
from mottrack.eval.nuscenes.rules import Rules
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import aligned

ONE_SCENE = "one scene says nothing about others: no interval"
SHOWN = ("amota", "amotp", "mota", "recall", "ids")


def bootstrap_report(prepared: Prepared, rules: Rules, resamples: int, out: Path) -> str:
    """Writes bootstrap.json with all intervals; returns a table of the leading ones."""
    if prepared.samples.scenes == 1:
        return ONE_SCENE
    weights = draw(prepared.samples.scenes, resamples)
    table = intervals(profiles(prepared, rules), weights, rules)
    content = {"resamples": resamples, "interpolation": rules.interpolation}
    write_text(out / "bootstrap.json", json.dumps(strict(content | {"metrics": as_plain(table)})))
    lines = [["class", *SHOWN]]
    lines += [[name, *(_interval(row[m]) for m in SHOWN)] for name, row in table.items()]
    title = f"95 % intervals over {resamples} resamples of {prepared.samples.scenes} scenes"
    return f"{title}\n{aligned(lines)}"


def comparison_report(
    pair: tuple[Prepared, Prepared], rules: Rules, resamples: int, out: Path
) -> str:
    """Writes comparison.json, the second minus the first; returns a table of the leading ones."""
    if pair[0].samples.scenes == 1:
        return ONE_SCENE
    weights = draw(pair[0].samples.scenes, resamples)
    sides = (profiles(pair[0], rules), profiles(pair[1], rules))
    table = compare(sides, weights, rules)
    content = {"resamples": resamples, "interpolation": rules.interpolation}
    plain = content | {"differences": as_plain(table)}
    write_text(out / "comparison.json", json.dumps(strict(plain)))
    lines = [["class", *SHOWN]]
    lines += [[name, *(_difference(row[m]) for m in SHOWN)] for name, row in table.items()]
    title = "difference to the first submission [95 % interval] probability of being better"
    return f"{title}\n{aligned(lines)}"


def _interval(item: Interval) -> str:
    return f"{item.value:.3f} [{item.low:.3f}, {item.high:.3f}]"


def _difference(item: Difference) -> str:
    inner = item.interval
    return f"{inner.value:+.3f} [{inner.low:+.3f}, {inner.high:+.3f}] {item.probability_better:.2f}"
