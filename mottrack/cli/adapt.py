"""`mottrack adapt`: the network is tuned to logs without labels."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mottrack.cli.arguments import Config, Overrides
from mottrack.cli.printed_tables import print_tables

if TYPE_CHECKING:
    from mottrack.flow.pillarflow.training.checkpoint import Progress
    from mottrack.studies.adaptation.config import AdaptConfig

PREFIX = "adapt."
"""Of the keys that set how the network is tuned; all others are those of an experiment."""


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("adapt")(adapt)


def adapt(
    config: Config,
    overrides: Overrides = None,
    *,
    out: Annotated[Path, typer.Option(help="the .safetensors file of the adapted weights")],
) -> None:
    """Tune the network to your own logs; keep the result only if it is better on them.

    The logs need sweeps and poses, no labels: the scenes of the experiment's data set. Labels are
    made by registration over several sweeps; pairs of the embedded world are mixed in. Stretches
    that took no part judge the result without labels. An interrupted command goes on where it
    stopped. Settings: adapt.steps=150, adapt.frames=80, adapt.weights=base and others.

    Example: mottrack adapt demo dataset.sensor=ring64 --out my/street.safetensors
    """
    from mottrack.core.errors import ConfigError, require_out_folder

    if out.suffix != ".safetensors":
        raise ConfigError(f"--out is {out}, expected a name that ends in .safetensors")
    require_out_folder(out.parent)
    typer.echo(f"adapt: work folder {out.with_suffix('.work')}", err=True)  # torch loads slowly
    from mottrack.experiment.experiment import load_experiments
    from mottrack.studies.adaptation.adapt import adapt as tune_to_logs
    from mottrack.studies.adaptation.tables import figure_table, world_table

    texts = overrides or []
    own = [text for text in texts if text.startswith(PREFIX)]
    experiments = load_experiments(config, [text for text in texts if text not in own])
    settings = _settings(own)
    # the flow of the file may be a sweep: its data set alone is of interest
    outcome = tune_to_logs(experiments[0], settings, out, _Printed())
    print_tables([figure_table(outcome.verdict), world_table(outcome.before, outcome.after)])
    typer.echo(f"report:  {out.with_suffix('.json')}")
    if not outcome.kept:
        typer.echo(f"the shipped weights stay: {outcome.reason}")
        return
    typer.echo(f"card:    {out.with_suffix('.md')}\nweights: {out}")
    typer.echo(f"use them with: mottrack run ... flow=pillarflow flow.weights={out}")


def _settings(texts: list[str]) -> AdaptConfig:
    """Return the settings that the overrides ask for."""
    from pydantic import ValidationError

    from mottrack.core.errors import ConfigError
    from mottrack.experiment.overrides import parse_override, set_key
    from mottrack.experiment.validation_message import format_validation_error
    from mottrack.studies.adaptation.config import AdaptConfig

    tree: dict[str, Any] = {}
    for text in texts:
        key, values = parse_override(text)
        if len(values) != 1:
            raise ConfigError(f"override '{text}' has several values; an adaptation takes one")
        set_key(tree, key, values[0])
    try:
        return AdaptConfig.model_validate(tree.get("adapt", {}))
    except ValidationError as error:
        message = format_validation_error(error, AdaptConfig, prefix="adapt")
        raise ConfigError(message) from error


class _Printed:
    """Prints the progress: every part, every tenth of the training."""

    def part(self, title: str, done: int, total: int) -> None:
        """Print how much of a part of the work is done."""
        typer.echo(f"{title} {done}/{total}", err=True)

    def training(self, progress: Progress, steps: int) -> None:
        """Print the loss now and then."""
        if progress.step % max(steps // 10, 1) == 0 or progress.step == steps:
            losses = [point["loss"] for point in progress.history if "loss" in point]
            loss = f", loss {losses[-1]:.3f}" if losses else ""
            typer.echo(f"train {progress.step}/{steps}{loss}", err=True)
