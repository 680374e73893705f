"""`mottrack eval` on tracks of any kind: finished runs, nuScenes submissions, KITTI results."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mottrack.cli.printed_tables import print_tables

if TYPE_CHECKING:
    from mottrack.eval.tracked_scenes import TrackedScenes

Tracks = dict[str, "TrackedScenes"]
Out = Annotated[Path, typer.Option("--out", help="Folder for the results.")]
Bootstrap = Annotated[int, typer.Option(min=2, help="Resamples of the intervals.")]


@dataclass(frozen=True)
class Given:
    """Options of every command that evaluates tracks."""

    runs: Annotated[
        list[Path] | None, typer.Argument(help="Finished runs; a folder of several gives all.")
    ] = None
    dataroot: Annotated[Path | None, typer.Option(help="nuScenes data of a submission.")] = None
    submission: Annotated[
        list[Path] | None, typer.Option(help="nuScenes tracking submission; may be repeated.")
    ] = None
    version: Annotated[str, typer.Option(help="Folder of the tables.")] = "v1.0-trainval"
    labels: Annotated[Path | None, typer.Option(help="Folder of KITTI labels.")] = None
    tracks: Annotated[
        list[Path] | None, typer.Option(help="Folder of KITTI results; may be repeated.")
    ] = None
    kind: Annotated[str, typer.Option("--class", help="KITTI class.")] = "Car"
    split: Annotated[str, typer.Option(help="Of nuScenes or KITTI, or a file of names.")] = "val"
    detections: Annotated[
        Path | None,
        typer.Option(
            help="What the trackers received: nuScenes detections, or KITTI's "
            "FOLDER/Class/0001.txt."
        ),
    ] = None

    def read(self) -> dict[str, TrackedScenes]:
        """Return all tracks by name.

        Raises:
            InputError: nothing is named, or two have the same name.
            MottrackError: a file is missing or malformed.
        """
        from mottrack.core.errors import InputError
        from mottrack.eval.kitti.files import Folders, sequences_of
        from mottrack.eval.nuscenes.command import Request
        from mottrack.pipeline.result_files import SubmissionFiles, of_kitti, of_submission
        from mottrack.runs.tracked_run import of_folders

        listed = list(of_folders(self.runs or []).items())
        if self.dataroot is not None:
            for path in self.submission or []:
                request = Request(self.dataroot, self.version, self.split, path)
                listed.append((path.stem, of_submission(SubmissionFiles(request, self.detections))))
        if self.labels is not None:
            for path in self.tracks or []:
                folders = Folders(self.labels, path, sequences_of(self.split))
                listed.append((path.name, of_kitti(folders, self.kind.lower(), self.detections)))
        if not listed:
            expected = "runs, --dataroot with --submission, or --labels with --tracks"
            raise InputError("arguments", "nothing to evaluate", expected)
        names = [name for name, _ in listed]
        if len(set(names)) < len(names):
            raise InputError("names of what is compared", ", ".join(names), "each name once")
        return dict(listed)


def of_tracks(command: Callable[..., None], *, detections: bool = True) -> Callable[..., None]:
    """Return a command line of a function of tracks: its first parameter becomes options.

    Args:
        command: takes tracks by name, then options of its own by keyword.
        detections: whether it uses the detections that the trackers received.
    """
    shared = dict(inspect.signature(Given, eval_str=True).parameters)
    if not detections:
        del shared["detections"]
    _, *own = inspect.signature(command, eval_str=True).parameters.values()

    @functools.wraps(command)
    def with_options(**options: Any) -> None:
        given = Given(**{name: options.pop(name) for name in shared})
        command(given.read(), **options)

    keyword = inspect.Parameter.KEYWORD_ONLY
    parameters = [p.replace(kind=keyword) for p in (*shared.values(), *own)]
    with_options.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    with_options.__annotations__ = {p.name: p.annotation for p in parameters}
    return with_options


def capabilities(
    given: Tracks,
    *,
    out: Out,
    bootstrap: Bootstrap = 400,
) -> None:
    """Draw identity over gaps, latency, neighbours, velocity errors, false boxes and time.

    Example: mottrack eval capabilities out/demo --out out/capabilities
    """
    from mottrack.eval.capabilities.curves import curves
    from mottrack.eval.capabilities.report import write_outputs
    from mottrack.eval.capabilities.tracking import of_scenes

    shown = {name: curves(of_scenes(scenes), bootstrap) for name, scenes in given.items()}
    print_tables(write_outputs(out, shown))
    typer.echo(f"picture: {out / 'capabilities.png'}")


def slices(
    given: Tracks,
    *,
    out: Out,
    by: Annotated[
        str,
        typer.Option(
            help="Columns, separated by commas: class, range, speed, points, occlusion, scene, or "
            "one of --columns; by default all but scene."
        ),
    ] = "",
    columns: Annotated[
        Path | None,
        typer.Option(help="CSV file: scene, at will id and frame, and columns of your own."),
    ] = None,
    bootstrap: Bootstrap = 400,
) -> None:
    """Compute recall, precision, MOTA, switches and errors by any property of the boxes.

    Example: mottrack eval slices out/demo --by range,occlusion --out out/slices
    """
    from mottrack.eval.slices.own_columns import read_own_columns
    from mottrack.eval.slices.report import DEFAULT_COLUMNS, sliced, write_outputs

    chosen = [name.strip() for name in by.split(",")] if by else list(DEFAULT_COLUMNS)
    if columns is not None:
        own = read_own_columns(columns)
        given = {name: own.added_to(scenes) for name, scenes in given.items()}
        chosen += [name for name in own.values if not by]
    print_tables(write_outputs(out, sliced(given, chosen, bootstrap)))


def calibration(
    given: Tracks,
    *,
    out: Out,
    bootstrap: Bootstrap = 400,
) -> None:
    """Compare the scores of tracks with how often they are right: reliability diagram and ECE.

    Example: mottrack eval calibration out/demo --out out/calibration
    """
    from mottrack.eval.paired import draw
    from mottrack.eval.slices.calibration import calibrations
    from mottrack.eval.slices.calibration_report import write_outputs

    found = {
        name: calibrations(scenes, draw(len(scenes.results), bootstrap))
        for name, scenes in given.items()
    }
    print_tables(write_outputs(out, found))
    if any(not isinstance(run, str) for run in found.values()):
        typer.echo(f"picture: {out / 'calibration.png'}")


def label_errors(
    given: Tracks,
    *,
    out: Out,
) -> None:
    """List what detections, flow and tracks agree on and the labels deny: probable label errors.

    Example: mottrack eval label-errors out/demo --out out/label_errors
    """
    from mottrack.eval.label_errors.report import write_outputs
    from mottrack.eval.label_errors.suspects import suspects

    print_tables(write_outputs(out, {name: suspects(scenes) for name, scenes in given.items()}))


def tracked_report(
    given: Tracks,
    *,
    out: Annotated[Path, typer.Option("--out", help="HTML file.")],
) -> None:
    """Write capability curves, slices, calibration and probable label errors as one page.

    Example: mottrack eval report --labels label_02 --tracks results --out out/tracks.html
    """
    from mottrack.report.tracked_page import write_tracked_page

    write_tracked_page(given, out)
    typer.echo(f"page: {out}")


def register(group: typer.Typer) -> None:
    """Add the verbs to `mottrack eval`."""
    group.command()(of_tracks(capabilities))
    group.command()(of_tracks(slices))
    group.command()(of_tracks(calibration, detections=False))
    group.command("label-errors")(of_tracks(label_errors))
    group.command("report")(of_tracks(tracked_report))
