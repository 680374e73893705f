"""``mottrack estimate-noise``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mottrack.cli.arguments import Config, Sweep
from mottrack.cli.printed_tables import print_tables

if TYPE_CHECKING:
    from mottrack.studies.tracker_noise import NoiseStudy

Out = Annotated[
    Path, typer.Option("--out", help="YAML file of a `tracker` group; replaced if it exists")
]


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("estimate-noise")(estimate_noise)
    app.command("calibrate-errors")(calibrate_errors)


def estimate_noise(
    config: Config,
    overrides: Sweep = None,
    *,
    out: Out,
    innovations: Annotated[
        bool,
        typer.Option(
            "--innovations",
            help="scale the noise of x, y to the innovations: honest gates, since errors that "
            "last are left out, and less than honest covariances of the tracks",
        ),
    ] = False,
) -> None:
    """Estimate the Kalman tracker's noise (P0, Q, R by class, R_d of the flow) from truth.

    The file that is written is a tracker group: put it into a folder `tracker` beside your
    experiment and name it there. A sweep over flow sources writes one file for each. What the
    detector finds and invents is counted and printed: probability of detection by range and
    occlusion, clutter, and scores as probabilities.

    Example: mottrack estimate-noise demo flow=icp --out tracker/mine.yaml
    """
    from mottrack.core.errors import require_out_folder
    from mottrack.core.storage import write_text
    from mottrack.experiment.experiment import load_experiments
    from mottrack.studies.detector_model import counts_table, rate_table
    from mottrack.studies.tracker_noise import study_noise

    require_out_folder(out.parent)
    experiments = load_experiments(config, overrides or [])
    for experiment in experiments:
        study = study_noise(experiment, _progress, innovations=innovations)
        name = f"{out.stem}-{experiment.variant}{out.suffix}" if len(experiments) > 1 else out.name
        file = out.with_name(name)
        write_text(file, _yaml(study))
        typer.echo(_table(study))
        print_tables([counts_table(study.detector), rate_table(study.detector)])
        typer.echo(f"noise:  {file}\n")


def calibrate_errors(
    config: Config,
    overrides: Sweep = None,
    *,
    out: Annotated[Path, typer.Option("--out", help="JSON file; its other sources are kept")],
) -> None:
    """Measure how the velocities of flow sources err: missed motions, outliers, R_d by class.

    A sweep over sources adds an entry for each. Of a source of your own the entry's numbers are
    settings of the tracker: tracker.velocity.relative and so on.

    Example: mottrack calibrate-errors velocity_errors flow=pillarflow --out errors.json
    """
    from mottrack.core.errors import require_out_folder
    from mottrack.core.velocity_errors import read_error_models
    from mottrack.experiment.experiment import load_experiments
    from mottrack.studies.velocity_errors import store, study_errors

    require_out_folder(out.parent)
    if out.exists():
        read_error_models(out)  # a file that is damaged is refused before anything is measured
    for experiment in load_experiments(config, overrides or []):
        study = study_errors(experiment, _progress)
        store(study, out)
        m = study.model
        typer.echo(
            f"{study.name}: relative {m.relative:.3f}, missed motion {m.p_missed_motion:.3f} "
            f"(slow, up to {m.missed_speed_mps:.1f} m/s, {m.p_missed_slow:.3f} more), outliers "
            f"{m.p_outlier:.3f} of {m.outlier_sigma_mps:.1f} m/s, "
            f"persistence {m.persistence:.3f}, "
            f"R_d {dict(m.class_variances)['all']:.3f} (m/s)^2; "
            f"{study.velocities} velocities, {study.moving} of movers; mean normalised square "
            f"error {study.consistency:.2f} (1: the stated covariance is right)"
        )
    typer.echo(f"errors:  {out}")


def _progress(scene: str, done: int, total: int) -> None:
    typer.echo(f"{scene}  ({done} of {total})", err=True)


def _yaml(study: NoiseStudy) -> str:
    import json

    import yaml

    lines = [f"# {line}".rstrip() for line in _table(study).splitlines()]
    settings = json.loads(json.dumps({"kind": "kalman", **study.settings}))
    body = yaml.safe_dump(settings, sort_keys=False, default_flow_style=None)
    return "\n".join(lines) + "\n" + body


def _table(study: NoiseStudy) -> str:
    """Return the estimates, the number of samples behind them, and the filter's consistency."""
    lines = [
        "class         pairs  outliers  accelerations   sigma x  y  z  yaw  (m, rad)  q (m2/s3)"
    ]
    for label, found in sorted(study.classes.items()):
        sigma = "  ".join(f"{v**0.5:.3f}" for v in found.noise.observation[:4])
        lines.append(
            f"{label:12} {found.pairs:6}  {found.outliers:8}  {found.accelerations:13}   "
            f"{sigma}  {found.noise.process[7]:.3f}"
        )
    if study.velocity is not None:
        v = study.velocity
        lines.append(
            f"R_d: {v.variance_m2ps2:.4f} (m/s)^2 from {v.measured} velocities, "
            f"bias {v.bias_mps[0]:+.3f} {v.bias_mps[1]:+.3f} m/s"
        )
        by_class = (f"{k} {x:.3f}" for k, x in sorted(v.class_variance_m2ps2.items()))
        lines.append(f"R_d by class: {', '.join(by_class)}")
    for when, results in (("before", study.before), ("after", study.after)):
        for what, c in results.items():
            lines.append(
                f"{what} {when}: {c.mean_ratio:.2f} of the expected mean (1 is consistent), "
                f"{c.inside_95:.1%} within 95 %, n = {c.count}"
            )
    return "\n".join(lines)
