"""Options that name tracks of any kind: finished runs, nuScenes submissions, KITTI results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from mottrack.eval.tracked_scenes import TrackedScenes

Runs = Annotated[
    list[Path] | None, typer.Argument(help="Finished runs; a folder of several gives all.")
]
Out = Annotated[Path, typer.Option("--out", help="Folder for the results.")]
Dataroot = Annotated[Path | None, typer.Option(help="nuScenes data of a submission.")]
Submissions = Annotated[
    list[Path] | None,
    typer.Option("--submission", help="nuScenes tracking submission; may be repeated."),
]
Version = Annotated[str, typer.Option(help="Folder of the tables.")]
Labels = Annotated[Path | None, typer.Option(help="Folder of KITTI labels.")]
KittiTracks = Annotated[
    list[Path] | None,
    typer.Option("--tracks", help="Folder of KITTI results; may be repeated."),
]
Kind = Annotated[str, typer.Option("--class", help="KITTI class.")]
Split = Annotated[str, typer.Option(help="Of nuScenes or KITTI, or a file of names.")]
DetectionFiles = Annotated[
    Path | None,
    typer.Option(
        "--detections",
        help="What the trackers received: nuScenes detections, or KITTI's FOLDER/Class/0001.txt.",
    ),
]
Bootstrap = Annotated[int, typer.Option(min=2, help="Resamples of the intervals.")]


@dataclass(frozen=True)
class Given:
    """What the command line names."""

    runs: list[Path] | None
    dataroot: Path | None
    submissions: list[Path] | None
    version: str
    labels: Path | None
    tracks: list[Path] | None
    kind: str
    split: str
    detections: Path | None

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
            for path in self.submissions or []:
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
