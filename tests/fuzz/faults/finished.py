"""A finished run, made once, and what is printed when its files were changed."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import yaml

from mottrack.experiment.experiment import hash_of, load_experiments
from mottrack.runs.comparison import run_comparison
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.runner import Execution
from tests.fuzz.faults.printed import Printed, command

SMALL = ["dataset.scenes=1", "dataset.duration_s=0.6", "dataset.sweep_hz=10", "dataset.key_hz=10"]


class Silent:
    """Progress that nobody watches."""

    def __getattr__(self, _name: str) -> Callable[..., None]:
        return lambda *_, **__: None


@cache
def finished(root: Path) -> Path:
    """Run the embedded world for half a second."""
    config = root / "zero.yaml"
    config.write_text("dataset: synthetic\nflow: zero\nscore_flow: false\n")
    experiments = load_experiments(str(config), SMALL)
    execution = Execution(LocalPool(1))
    run_comparison(experiments, root / "finished", execution=execution, progress=Silent())
    return root / "finished"


def reported(change: Callable[[Path], object]) -> Printed:
    """What `report` prints of a copy of the run that was changed."""

    def printed(root: Path) -> str:
        copy = root / "run"
        shutil.copytree(finished(root), copy)
        try:
            change(copy)
            return command("report", "{root}/run")(root)
        finally:
            shutil.rmtree(copy)

    return printed


def _edit(run: Path) -> None:
    file = run / "config.yaml"
    file.write_text(file.read_text().replace("kind: zero", "kind: icp"))


def _rename_parts(run: Path) -> None:
    """Change the configuration and what was noted of it, as a stranger could."""
    file = run / "config.yaml"
    tree = yaml.safe_load(file.read_text()) | {"tracker": {"kind": "evil_mod:X"}}
    file.write_text(yaml.safe_dump(tree))
    noted = json.loads((run / "run.json").read_text()) | {"configuration": hash_of(tree)}
    (run / "run.json").write_text(json.dumps(noted))


def times(suffix: str, text: str) -> Printed:
    """What `report` prints when a file of times holds another text."""

    def write(run: Path) -> None:
        (file,) = run.glob(f"scenes/*.{suffix}")
        file.write_text(text)

    return reported(write)


def stranger(root: Path) -> str:
    """What `report` prints of a run whose configuration names a module of its own."""
    (root / "evil_mod.py").write_text("class X: pass\n")
    sys.path.insert(0, str(root))
    try:
        text = reported(_rename_parts)(root).splitlines()[-1]
    finally:
        sys.path.remove(str(root))
    return f"{text} (evil_mod imported: {'evil_mod' in sys.modules})"


edited = reported(_edit)
