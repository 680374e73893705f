"""`mottrack tune`: settings of a tracker, chosen by leaving scenes out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mottrack.cli.arguments import Config, Overrides
from mottrack.cli.printed_tables import print_tables

if TYPE_CHECKING:
    from mottrack.studies.tuning.search import Search, Tuned


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("tune")(tune)


def tune(  # noqa: PLR0913
    config: Config,
    overrides: Overrides = None,
    *,
    setting: Annotated[
        list[str],
        typer.Option(
            help="key of the tracker to vary: KEY (range from its bounds, or a quarter to four "
            "times its value), KEY=LOW..HIGH or KEY=A|B; repeat it"
        ),
    ],
    out: Annotated[Path, typer.Option(help="folder for trials, tables and the tuned tracker")],
    objective: Annotated[
        str, typer.Option(help="amota, mota, hota, idf1 or velocity_error")
    ] = "amota",
    trials: Annotated[int, typer.Option(min=1, help="trials in each search")] = 60,
    folds: Annotated[int, typer.Option(min=2, help="groups of scenes, left out in turn")] = 4,
    seed: Annotated[int, typer.Option(help="of the search")] = 0,
) -> None:
    """Tune a tracker's settings, and report what they gain on scenes that took no part.

    Flow and objects are computed once. One search for each fold of scenes leaves that fold out and
    is judged on it; one over all scenes gives the settings that are written. An interrupted
    command goes on where it stopped.

    Example: mottrack tune demo flow=pillarflow dataset.scenes=8 --setting association.gate
    --setting track_management.p_detection --out out/tune
    """
    from mottrack.config import StrictModel
    from mottrack.core.errors import ConfigError, require_out_folder, unknown_name
    from mottrack.experiment.experiment import load_experiments
    from mottrack.studies.tuning.objectives import OBJECTIVES
    from mottrack.studies.tuning.recorded import record
    from mottrack.studies.tuning.search import Search, claim
    from mottrack.studies.tuning.search import tune as search_folds
    from mottrack.studies.tuning.search_space import settings_of

    require_out_folder(out)
    if objective not in OBJECTIVES:
        raise unknown_name("objective", objective, OBJECTIVES)
    experiments = load_experiments(config, overrides or [])
    if len(experiments) > 1:
        raise ConfigError(f"{config} is a sweep of {len(experiments)} runs; tune one of them")
    (experiment,) = experiments
    own = experiment.tracker.config
    if not isinstance(own, StrictModel):
        raise ConfigError(f"tracker '{experiment.tracker.kind}' declares no settings")
    settings = tuple(settings_of(own, setting))
    search = Search(experiment, settings, OBJECTIVES[objective], trials, seed)
    claim(search, folds, out)
    scenes = record(experiment, _scene_done)
    tuned = search_folds(search, scenes, folds, out, _trial_done)
    _write(search, tuned, out)


def _scene_done(scene: str, done: int, total: int) -> None:
    typer.echo(f"{scene}  ({done} of {total})", err=True)


def _trial_done(name: str, done: int, total: int, best: float) -> None:
    if done % 10 == 0 or done == total:
        typer.echo(f"{name}: trial {done} of {total}, best {best:.4f}", err=True)


def _write(search: Search, tuned: Tuned, out: Path) -> None:
    """Print and write the tables and the tuned tracker."""
    from mottrack.core.storage import write_text
    from mottrack.formats.text_table import write_tables
    from mottrack.studies.tuning.tables import found_table, gain_table, tracker_yaml

    tables = [gain_table(tuned), found_table(search, tuned)]
    write_tables(tables, out / "tables")
    print_tables(tables)
    file = out / "tracker" / "tuned.yaml"
    write_text(file, tracker_yaml(search, tuned))
    typer.echo(f"tables:  {out / 'tables'}\ntracker: {file}")
