"""Outcomes of a stress study as JSON, tables and a picture."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mottrack.core.storage import write_text
from mottrack.eval.paired import CONFIDENCE, Sampled
from mottrack.eval.slices.report import interval_text
from mottrack.formats.strict_json import strict
from mottrack.formats.text_table import Cell, Column, TextTable, write_tables
from mottrack.studies.stress.damage import DAMAGES
from mottrack.studies.stress.figures import FIGURES, VELOCITY
from mottrack.studies.stress.study import Outcome, breaking_amount, hurting_amount

SHOWN = ("hota", "idf1", "amota", VELOCITY)
"""Figures that are drawn and printed; the file holds all."""
NAMES = {"hota": "HOTA", "idf1": "IDF1", "amota": "AMOTA", VELOCITY: "velocity error [m/s]"}


def write_outputs(folder: Path, found: Sequence[Outcome]) -> list[TextTable]:
    """Write `stress.json`, a table for each kind of damage and `stress.png`; return the tables."""
    content = strict([_plain(one, found) for one in found])
    write_text(folder / "stress.json", json.dumps(content, indent=1, allow_nan=False))
    tables = [breaks_table(found)]
    tables += [_table(kind, [o for o in found if o.stress.kind == kind]) for kind in _kinds(found)]
    write_tables(tables, folder / "tables")
    draw(folder / "stress.png", found)
    return tables


def _kinds(found: Sequence[Outcome]) -> list[str]:
    return list(dict.fromkeys(o.stress.kind for o in found))


def by_tracker(found: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    """Return the outcomes of each tracker, the undamaged one first."""
    names = dict.fromkeys(o.tracker for o in found)
    return {name: [o for o in found if o.tracker == name] for name in names}


def _plain(one: Outcome, found: Sequence[Outcome]) -> dict[str, Any]:
    """Return figures, losses to the undamaged run and differences to the first tracker."""
    same = [o for o in found if o.stress.kind == one.stress.kind]
    clean = by_tracker(same)[one.tracker][0]
    first = next(o for o in same if o.stress == one.stress)
    figures = {name: _interval(one.figures[name]) for name in FIGURES}
    loss = {name: one.against(clean, name).as_dict() for name in FIGURES if one is not clean}
    other = {name: one.against(first, name).as_dict() for name in FIGURES if one is not first}
    place = {"tracker": one.tracker, "kind": one.stress.kind, "amount": one.stress.amount}
    return {**place, "figures": figures, "to_undamaged": loss, "to_first_tracker": other}


def _interval(found: Sampled) -> dict[str, float]:
    low, high = found.interval()
    return {"value": found.value, "low": low, "high": high}


def breaks_table(found: Sequence[Outcome]) -> TextTable:
    """Return a line per damage and tracker: from which amount it is worse, and where it breaks."""
    rows: list[tuple[Cell, ...]] = []
    for kind in _kinds(found):
        damage = DAMAGES[kind]
        for tracker, own in by_tracker([o for o in found if o.stress.kind == kind]).items():
            hurt, broken = (f(own, "hota") for f in (hurting_amount, breaking_amount))
            last = own[-1].figures["hota"].value / own[0].figures["hota"].value
            places = (_amount(a, own[-1].stress.amount) for a in (hurt, broken))
            rows.append((damage.title, damage.unit, tracker, *places, last))
    heads = ("damage", "unit", "tracker", "worse from", "breaks at", "HOTA kept at the end")
    note = (
        f"Worse: HOTA lower than undamaged, {CONFIDENCE:.0%} paired intervals over scenes. Breaks: "
        "half of the undamaged HOTA is lost"
    )
    columns = tuple(Column(head, 2) for head in heads)
    return TextTable("stress", "Where trackers break", columns, tuple(rows), note)


def _amount(found: float | None, last: float) -> str:
    return f"not up to {last:g}" if found is None else f"{found:g}"


def _table(kind: str, found: Sequence[Outcome]) -> TextTable:
    """Return a line per tracker and amount with the shown figures."""
    damage, trackers = DAMAGES[kind], by_tracker(found)
    heads = ["tracker", damage.unit, *(NAMES[name] for name in SHOWN)]
    if len(trackers) > 1:
        heads.append(f"HOTA against {next(iter(trackers))}")
    rows: list[tuple[Cell, ...]] = []
    for own in trackers.values():
        for one in own:
            cells = (_cell(one, own[0], name) for name in SHOWN)
            rows.append((one.tracker, f"{one.stress.amount:g}", *cells, *_against(one, found)))
    note = f"{CONFIDENCE:.0%} intervals over scenes; * significantly worse than undamaged."
    columns = tuple(Column(head) for head in heads)
    return TextTable(f"stress_{kind}", damage.title, columns, tuple(rows), note)


def _cell(one: Outcome, clean: Outcome, figure: str) -> str:
    worse = one is not clean and one.against(clean, figure).better is False
    return interval_text(one.figures[figure]) + ("*" if worse else "")


def _against(one: Outcome, found: Sequence[Outcome]) -> Iterator[str]:
    """Yield the difference to the first tracker under the same damage, where there are several."""
    if len({o.tracker for o in found}) < 2:
        return
    first = next(o for o in found if o.stress == one.stress)
    if one is first:
        yield ""
        return
    d = one.against(first, "hota")
    interval = "" if d.low != d.low else f" [{d.low:+.3f}, {d.high:+.3f}]"
    verdict = {True: " better", False: " worse", None: ""}[d.better]
    yield f"{d.difference:+.3f}{interval}{verdict}"


def draw(path: Path, found: Sequence[Outcome]) -> None:
    """Draw every shown figure along the amount, a row of panels for each kind of damage."""
    from matplotlib.figure import Figure  # slow to import

    kinds = _kinds(found)
    figure = Figure(figsize=(4.4 * len(SHOWN), 2.7 * len(kinds)), layout="constrained")
    axes = np.atleast_2d(figure.subplots(len(kinds), len(SHOWN)))
    for row, kind in zip(axes, kinds, strict=True):
        trackers = by_tracker([o for o in found if o.stress.kind == kind])
        for axis, name in zip(row, SHOWN, strict=True):
            for tracker, own in trackers.items():
                _line(axis, tracker, own, name)
            axis.set_xlabel(f"{DAMAGES[kind].title} [{DAMAGES[kind].unit}]")
            axis.set_ylabel(NAMES[name])
            axis.set_ylim(bottom=0)
            axis.grid(alpha=0.3)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4) or 1)
    figure.savefig(path, dpi=90)


def _line(axis: Any, tracker: str, own: Sequence[Outcome], name: str) -> None:
    amounts = np.array([o.stress.amount for o in own])
    values = np.array([o.figures[name].value for o in own])
    low, high = np.array([o.figures[name].interval() for o in own]).T
    (line,) = axis.plot(amounts, values, "o-", ms=3, label=tracker)
    if not np.isnan(low).all():
        axis.fill_between(amounts, low, high, color=line.get_color(), alpha=0.13, lw=0)
