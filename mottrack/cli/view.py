"""``mottrack view``, ``animate`` and ``animate-map``."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from mottrack.cli.arguments import Config, FinishedRun, Overrides, SceneName
from mottrack.core.arrays import U8

Out = Annotated[Path, typer.Option("--out", help="the animation, .gif or .mp4")]
Speed = Annotated[
    float, typer.Option("--speed", min=0.05, max=20.0, help="playback speed; 1 is real time")
]


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("view")(view)
    app.command("animate")(animate)
    app.command("animate-map")(animate_map)


def view(
    run: FinishedRun,
    *,
    scene: Annotated[str | None, typer.Option("--scene", help="by default all scenes")] = None,
    save: Annotated[
        Path | None, typer.Option("--save", help="write a .rrd file instead of opening a window")
    ] = None,
) -> None:
    """Show the scenes of a run in rerun: points, flow, boxes, tracks, velocities, truth."""
    from mottrack.runs.run_folder import StoredScene, pick_scene, stored_scenes
    from mottrack.viz.recording import Recording

    for name in stored_scenes(run) if scene is None else [pick_scene(run, scene)]:
        stored = StoredScene.load(run, name)
        recording = Recording.of(name)
        if save is None:
            recording.show()
        else:
            several = scene is None and len(stored_scenes(run)) > 1
            file = save.with_stem(f"{save.stem}-{name}") if several else save
            recording.write_to(file)
            typer.echo(str(file))
        recording.log(stored.result, stored.snapshots)


def animate(
    run: FinishedRun,
    *,
    out: Out,
    scene: SceneName = None,
    reach_m: Annotated[
        float, typer.Option("--reach", min=5.0, max=200.0, help="half the width shown, m")
    ] = 40.0,
    speed: Speed = 1.0,
) -> None:
    """Write a scene of a run as an animation seen from above."""
    from mottrack.runs.run_folder import StoredScene, pick_scene
    from mottrack.viz.bev import draw_key_frames, key_frame_period_s

    stored = StoredScene.load(run, pick_scene(run, scene))
    pictures = draw_key_frames(stored.result, stored.snapshots, reach_m=reach_m)
    _write(out, pictures, key_frame_period_s(stored.result) / speed)


def animate_map(
    config: Config,
    overrides: Overrides = None,
    *,
    out: Out,
    scene: SceneName = None,
    speed: Speed = 1.0,
) -> None:
    """Run DOGMa over a scene and write its map as an animation: free, occupied, moving cells."""
    from mottrack.core.errors import ConfigError
    from mottrack.experiment.experiment import load_experiments
    from mottrack.runs.runner import scene_names
    from mottrack.studies.dogma_animation import map_pictures, sweep_period_s
    from mottrack.viz.dogma import draw_map

    experiments = load_experiments(config, ["flow=dogma", *(overrides or [])])
    if len(experiments) > 1:
        raise ConfigError(
            f"{len(experiments)} experiments, expected one: the map of one filter is drawn"
        )
    name = scene or scene_names(experiments[0])[0]
    opened = experiments[0].dataset.make().scene(name)
    pictures = (draw_map(picture) for picture in map_pictures(experiments[0], opened))
    _write(out, pictures, sweep_period_s(opened) / speed)


def _write(out: Path, pictures: Iterable[U8], period_s: float) -> None:
    from mottrack.viz.animation import write_animation

    count = write_animation(out, pictures, period_s)
    typer.echo(f"{out}: {count} pictures")
