"""What an adaptation has found, and the card of the weights that says so."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from mottrack.experiment.experiment import Experiment
from mottrack.flow.pillarflow.training.validation import Scores
from mottrack.formats.text_table import to_markdown
from mottrack.studies.adaptation.config import AdaptConfig, Files
from mottrack.studies.adaptation.judgement import Verdict
from mottrack.studies.adaptation.pseudo_labels import Coverage
from mottrack.studies.adaptation.stretches import Split
from mottrack.studies.adaptation.tables import figure_table, world_table


@dataclass(frozen=True)
class Outcome:
    """What an adaptation has found."""

    verdict: Verdict
    before: Scores
    """On held-out pairs of the embedded world."""
    after: Scores
    covered: Coverage
    split: Split
    reason: str
    """Why the weights are not kept; empty where they are."""

    @property
    def kept(self) -> bool:
        """Whether the adapted weights were written."""
        return not self.reason

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain data."""
        return {
            "kept": self.kept,
            "reason": self.reason,
            "training stretches": [s.name for s in self.split.training],
            "held-out stretches": [s.name for s in self.split.held_out],
            "labelled cells": asdict(self.covered),
            "held-out figures without labels": self.verdict.as_dict(),
            "embedded world": {"before": asdict(self.before), "after": asdict(self.after)},
        }


def card_text(files: Files, experiment: Experiment, config: AdaptConfig, outcome: Outcome) -> str:
    """Return the card as Markdown."""
    changed = config.model_dump(mode="json", exclude_defaults=True)
    settings = ", ".join(f"`adapt.{k}={v}`" for k, v in changed.items()) or "the defaults"
    covered = outcome.covered
    lines = [
        f"# {files.out.stem}",
        "",
        "| | |",
        "|---|---|",
        f"| begun with | weights `{config.weights}` |",
        f"| logs | {experiment.data}, without labels |",
        f"| command | `mottrack adapt`, settings: {settings} |",
        f"| seed | {config.seed} |",
        f"| labels by registration | {covered.moving} moving and {covered.static} resting cells of "
        f"{covered.cells} |",
        f"| length | {config.steps} steps of {config.batch_size} crops, "
        f"{config.synthetic_share:.0%} of them of the embedded world |",
        f"| stretches | {len(outcome.split.training)} trained, "
        f"{outcome.verdict.stretches} held out |",
        "| covariance and error model | those of the weights it was begun with |",
        "",
        to_markdown(figure_table(outcome.verdict)),
        to_markdown(world_table(outcome.before, outcome.after)),
        "",
    ]
    return "\n".join(lines)
