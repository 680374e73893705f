"""The card of adapted weights: how they were made and what they are worth, for a reader."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mottrack.experiment.experiment import Experiment
from mottrack.formats.text_table import to_markdown
from mottrack.studies.adaptation.config import AdaptConfig, Files
from mottrack.studies.adaptation.tables import figure_table, world_table

if TYPE_CHECKING:
    from mottrack.studies.adaptation.adapt import Outcome


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
