from pathlib import Path

import pytest

from mottrack.experiment.experiment import compose
from mottrack.runs.comparison import Comparison, run_comparison
from mottrack.runs.local_pool import LocalPool
from mottrack.runs.runner import Execution
from mottrack.runs.tasks import Progress

MARKUP = "<script>alert(2)<!--"
TITLE = "toys & </script><script>alert(1)"


@pytest.fixture(scope="session")
def comparison(tmp_path_factory: pytest.TempPathFactory, progress: Progress) -> Comparison:
    """Run two flow sources on three toy scenes: one whose name is markup, one that fails."""
    tree = {
        "name": TITLE,
        "dataset": {"kind": "toy_plugins:ToyDataset", "scenes": [MARKUP, "b", "poison"]},
        "flow": [{"kind": "zero"}, {"kind": "toy_plugins:ConstantFlow"}],
        "tracker": {"kind": "lossy_plugins:LossyTracker"},
    }
    experiments = compose(tree, [], Path("toy.yaml"))
    out = tmp_path_factory.mktemp("report") / "run"
    return run_comparison(experiments, out, execution=Execution(LocalPool(2)), progress=progress)
