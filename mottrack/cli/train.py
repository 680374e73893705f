"""``mottrack train``, ``examples``, ``calibrate``, ``validate-flow`` and ``export``."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mottrack.cli.arguments import Cluster, Overrides, Results, Sweep, Workers
from mottrack.cli.execution import Where

if TYPE_CHECKING:
    from mottrack.flow.pillarflow.training.config import ExamplesConfig, TrainConfig

Config = Annotated[str, typer.Argument(help="YAML file of a training run, or a shipped one")]
Out = Annotated[Path, typer.Option("--out", help="folder of the run; a checkpoint is resumed")]
Examples = Annotated[Path, typer.Option("--examples", help="folder of the sets of examples")]
ExampleWorkers = Annotated[
    int, typer.Option("--workers", min=0, help="processes that make examples; 0: one per core")
]
ExampleCluster = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        help="make the examples on Ray: ray (this machine), auto, HOST:PORT or ray://HOST:PORT",
    ),
]
ExamplesOut = Annotated[Path, typer.Option("--out", help="folder of the sets of examples")]


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("train")(train)
    app.command("examples")(examples)
    app.command("calibrate")(calibrate)
    app.command("validate-flow")(validate_flow)
    app.command("export")(export)


def train(  # noqa: PLR0913
    config: Config,
    overrides: Overrides = None,
    *,
    out: Out,
    examples: Examples = Path("out/examples"),
    workers: ExampleWorkers = 0,
    cluster: ExampleCluster = None,
    results: Results = "driver",
) -> None:
    """Train a PillarFlow network; under torchrun on all its processes.

    Example: mottrack train train_base steps=2000 --out runs/base
    """
    from mottrack.cli.work_bar import WorkBar
    from mottrack.core.errors import require_out_folder
    from mottrack.flow.pillarflow.training.shards import Shards
    from mottrack.flow.pillarflow.training.trainer import run

    require_out_folder(out)
    settings = _read(config, overrides or [])
    folder = _examples(settings.examples, examples, Where(workers, cluster, results))
    training, held_out = Shards(folder / "training"), Shards(folder / "validation")
    with WorkBar("train", settings.steps) as bar:
        scores = run(settings, out, training, held_out, bar.training)
    if scores is not None:
        for name, value in asdict(scores).items():
            typer.echo(f"{name:20} {value:.3f}")


def examples(  # noqa: PLR0913
    config: Config,
    overrides: Overrides = None,
    *,
    out: ExamplesOut = Path("out/examples"),
    workers: Workers = 0,
    cluster: Cluster = None,
    results: Results = "driver",
    shard: Annotated[
        str | None,
        typer.Option("--shard", help="I/N: make a part; N machines share the folder of --out"),
    ] = None,
) -> None:
    """Make the examples of a training run before it starts.

    Example: mottrack examples train_base --out out/examples
    """
    settings = _read(config, overrides or [])
    where = Where(workers, cluster, results, shard)
    typer.echo(str(_examples(settings.examples, out, where)))


def export(
    weights: Annotated[str, typer.Argument(help="shipped weights by name, or a file")],
    *,
    out: Annotated[Path, typer.Option("--out", help="the .onnx file to write")],
) -> None:
    """Write the network behind the pillars as ONNX and check it in onnxruntime.

    Example: mottrack export base --out model.onnx
    """
    from mottrack.core.grid import BevGrid
    from mottrack.flow.pillarflow.export import export_onnx
    from mottrack.flow.pillarflow.source import weights_path
    from mottrack.flow.pillarflow.weights_file import load_weights

    loaded = load_weights(weights_path(weights))
    worst_m = export_onnx(loaded, out, loaded.network.cells(BevGrid()))
    typer.echo(f"{out}: onnxruntime differs by at most {worst_m:.2g} m")


def calibrate(
    weights: Annotated[Path, typer.Argument(help="weights file; its calibration is replaced")],
    *,
    pairs: Annotated[int, typer.Option("--pairs", min=2, help="held-out pairs")] = 60,
) -> None:
    """Fit the covariance of trained weights to their errors on held-out pairs.

    Example: mottrack calibrate runs/base/weights.safetensors --pairs 60
    """
    from mottrack.cli.work_bar import WorkBar
    from mottrack.studies.flow_calibration import calibrate_weights

    with WorkBar("pairs", pairs) as bar:
        study = calibrate_weights(weights, pairs, bar.pairs)
    fit = study.calibration
    typer.echo(f"scale {fit.scale:.4g}  sigma {fit.sigma_m:.3g} m  half {fit.half_m:.3g} m")
    typer.echo(f"{'':20} before   after")
    before, after = asdict(study.before), asdict(study.after)
    for name, value in after.items():
        typer.echo(f"{name:20} {before[name]:6.3f}  {value:6.3f}")


def validate_flow(
    overrides: Sweep = None,
    *,
    pairs: Annotated[int, typer.Option("--pairs", min=1, help="held-out pairs")] = 40,
) -> None:
    """Score flow sources on held-out pairs of the embedded world, cell by cell.

    Cells at rest are sorted by the share of their points that the earlier sweep could not see, and
    by the speed of the vehicle. Settings are those of `flow` and `grid`; weights of a training run
    are flow.weights=FILE.

    Example: mottrack validate-flow flow=pillarflow_raw,pillarflow --pairs 40
    """
    from mottrack.cli.printed_tables import print_tables
    from mottrack.cli.work_bar import WorkBar
    from mottrack.core.errors import ConfigError
    from mottrack.experiment.configs import shipped_folder
    from mottrack.experiment.experiment import compose
    from mottrack.experiment.overrides import parse_override
    from mottrack.studies.held_out_cells import cells_table, study_cells

    for text in overrides or []:
        key = parse_override(text)[0]
        if key.partition(".")[0] not in ("flow", "grid"):
            raise ConfigError(f"key {key} has no effect here, expected one of flow and grid")
    experiments = compose({}, overrides or [], shipped_folder() / "validate-flow")
    sources = {
        e.variant or e.flow.kind: e.flow.make(grid=e.settings.grid.grid()) for e in experiments
    }
    with WorkBar("pairs", pairs) as bar:
        cells = study_cells(sources, pairs, bar.pairs)
    print_tables(cells_table(name, own) for name, own in cells.items())


def _read(config: str, overrides: list[str]) -> TrainConfig:
    from pydantic import ValidationError

    from mottrack.core.errors import ConfigError
    from mottrack.experiment.configs import find_config
    from mottrack.experiment.overrides import parse_override, set_key
    from mottrack.experiment.validation_message import format_validation_error
    from mottrack.flow.pillarflow.training.config import TrainConfig
    from mottrack.formats.yaml_file import read_yaml

    path = find_config(config)
    tree = read_yaml(path)
    for text in overrides:
        key, values = parse_override(text)
        if len(values) != 1:
            raise ConfigError(f"override '{text}' has several values; a training run takes one")
        set_key(tree, key, values[0])
    try:
        return TrainConfig.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(f"{path}: {format_validation_error(error, TrainConfig)}") from error


def _examples(config: ExamplesConfig, parent: Path, where: Where) -> Path:
    """Make the examples; a later rank of torchrun waits for the first to have made them."""
    from mottrack.runs.progress import TerminalProgress
    from mottrack.runs.ray_connection import disconnect
    from mottrack.studies.example_sets import ExampleSet, await_examples, make_examples

    examples = ExampleSet.within(parent, config)
    if int(os.environ.get("RANK", "0")):
        if os.environ.get("LOCAL_RANK") == "0" and not examples.complete.exists():
            typer.echo(f"waiting for {examples.complete}, which the process of rank 0 writes")
        await_examples(examples)
    else:
        with TerminalProgress(unit="shards") as progress:
            make_examples(examples, execution=where.execution(), progress=progress)
        disconnect()
    return examples.path
