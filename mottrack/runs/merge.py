"""Join the shards of one run or several into the folder that one machine would have made."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, zip_longest
from pathlib import Path

from mottrack.core.errors import ConfigError, ResultError, require_exists
from mottrack.core.storage import write_bytes, write_files, write_text
from mottrack.runs.run_folder import RESULT, SNAPSHOTS, RunFolder
from mottrack.runs.runner import RunReport
from mottrack.runs.shard import Shard, ShardRecord, read_records

IDENTITY, MACHINES = "run.json", "machine.json"


@dataclass(frozen=True)
class Part:
    """One shard of one run, in the folder that a machine has made."""

    folder: RunFolder
    record: ShardRecord


@dataclass(frozen=True)
class Merged:
    """What has been joined."""

    reports: Mapping[Path, RunReport]
    """Run, by its path below the output, to its scenes; in the order in which they were run."""
    repeated: tuple[str, ...]
    """Shards that several folders hold, as ``2/5 (a, b)``; their results were the same."""


def merge_shards(sources: Sequence[Path], out: Path) -> Merged:
    """Copy the results of all shards into one folder: that of the unsharded run, to the byte.

    Args:
        sources: what the shards were given as ``--out``, in any order.
        out: folder for the joined results; nothing is written before everything is checked.

    Raises:
        ConfigError: a source does not exist, a shard is missing, was interrupted or counts
            otherwise, shards are of different runs, or one that is held twice differs.
        ResultError: a record is damaged.
    """
    for source in sources:
        require_exists(source, "the folder of a shard")
    runs = _runs(sources)
    if not runs:
        places = ", ".join(map(str, sources))
        raise ConfigError(f"{places}: no shard of any run; expected folders of --shard runs")
    runs = dict(sorted(runs.items(), key=lambda item: item[1][0].record.row))
    checked = {path: _checked(path, parts, len(sources)) for path, parts in runs.items()}
    reports = {path: _copy(parts, RunFolder(out / path)) for path, parts in checked.items()}
    _join_machines(sources, out)
    repeated = chain.from_iterable(map(_repeated, runs.values()))
    return Merged(reports, tuple(dict.fromkeys(repeated)))


def _runs(sources: Sequence[Path]) -> dict[Path, list[Part]]:
    """Return the parts of every run, by its path within the sources."""
    runs: dict[Path, list[Part]] = defaultdict(list)
    for source in sources:
        found = sorted(source.rglob(IDENTITY))
        if not found:
            raise ConfigError(f"{source} holds no run; expected the folder of a --shard run")
        for identity in found:
            folder = RunFolder(identity.parent)
            records = read_records(folder.path)
            if not records:
                raise ConfigError(f"{folder.path} holds no finished shard; run it again to its end")
            runs[folder.path.relative_to(source)] += [Part(folder, r) for r in records]
    return dict(runs)


def _checked(path: Path, parts: list[Part], sources: int) -> list[Part]:
    """Return the parts in the order of their shards, each once."""
    first = parts[0]
    for part in parts:
        if part.folder.identity_file.read_bytes() != first.folder.identity_file.read_bytes():
            raise ConfigError(
                f"{part.folder.path} is of another configuration, code or weights than "
                f"{first.folder.path} (run.json)"
            )
        if part.record.shard.count != first.record.shard.count:
            raise ConfigError(
                f"{part.folder.path} is shard {part.record.shard}, {first.folder.path} is shard "
                f"{first.record.shard}: expected the same number of shards"
            )
    kept: dict[Shard, Part] = {}
    for part in parts:
        known = kept.setdefault(part.record.shard, part)
        if known is not part:
            kept[part.record.shard] = _the_better(known, part)
    count = first.record.shard.count
    missing = [str(s) for k in range(count) if (s := Shard(k + 1, count)) not in kept]
    if missing:
        raise ConfigError(
            f"{path if path.name else 'the run'}: shard {', '.join(missing)} missing among "
            f"{sources} folders; run it, then merge again"
        )
    return [kept[shard] for shard in sorted(kept)]


def _the_better(known: Part, other: Part) -> Part:
    """Return the one of two copies of a shard with fewer failures.

    Raises:
        ConfigError: a scene that both have finished differs.
    """
    failed = {*known.record.failed, *other.record.failed}
    for scene in known.record.scenes:
        files = [part.folder.scene_file(scene) for part in (known, other)]
        if scene not in failed and files[0].read_bytes() != files[1].read_bytes():
            raise ConfigError(f"{files[0]} and {files[1]} differ, expected the same bytes")
    return min(known, other, key=lambda part: len(part.record.failed))


def _copy(parts: list[Part], out: RunFolder) -> RunReport:
    """Copy the files of a run; return its scenes in the order of the data set."""
    first = parts[0].folder
    failed: dict[str, str] = {}
    for part in parts:
        failed |= part.record.failed
        for scene in part.record.scenes:
            if scene not in part.record.failed:
                files = part.folder.files(scene)
                if not any(n.endswith(RESULT) and not n.endswith(SNAPSHOTS) for n in files):
                    raise ResultError(part.folder.scene_file(scene), "file", "absent", "a result")
                write_files(out.path, files)
    for file in (first.config_file, first.identity_file):
        write_bytes(out.path / file.name, file.read_bytes())
    turns = zip_longest(*(part.record.scenes for part in parts))
    scenes = [scene for scene in chain.from_iterable(turns) if scene is not None]
    finished = tuple(scene for scene in scenes if scene not in failed)
    ordered = {scene: failed[scene] for scene in scenes if scene in failed}
    return RunReport(finished, ordered, resumed=0)


def _join_machines(sources: Sequence[Path], out: Path) -> None:
    """Join the lists of machines on which the paper's runtimes were measured."""
    machines: dict[Path, list[str]] = defaultdict(list)
    for source in sources:
        for file in source.rglob(MACHINES):
            machines[file.relative_to(source)] += json.loads(file.read_text(encoding="utf-8"))
    for path, names in machines.items():
        write_text(out / path, json.dumps(list(dict.fromkeys(names)), indent=1) + "\n")


def _repeated(parts: Sequence[Part]) -> list[str]:
    holders: dict[Shard, list[str]] = defaultdict(list)
    for part in parts:
        holders[part.record.shard].append(str(part.folder.path))
    return [f"{shard} ({', '.join(places)})" for shard, places in holders.items() if places[1:]]
