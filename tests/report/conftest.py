from pathlib import Path

import pytest

from mottrack.pipeline.comparison import Comparison, run_comparison
from mottrack.pipeline.experiment import compose

TOYS = Path(__file__).parents[1] / "pipeline"
MARKUP = "<script>alert(2)<!--"
TITLE = "toys & </script><script>alert(1)"


class SilentProgress:
    def begin(self, title: str, scenes: int, todo: int) -> None: ...

    def frames(self, scene: str, done: int, total: int) -> None: ...

    def scene_ends(self, outcome: object) -> None: ...


@pytest.fixture(scope="session")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> Comparison:
    """Two flow sources on three toy scenes: one with a name that is markup, one that fails."""
    tree = {
        "name": TITLE,
        "dataset": {"kind": "toy_plugins:ToyDataset", "scenes": [MARKUP, "b", "poison"]},
        "flow": [{"kind": "zero"}, {"kind": "toy_plugins:ConstantFlow"}],
        "tracker": {"kind": "lossy_plugins:LossyTracker"},
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(TOYS))
        patch.syspath_prepend(str(Path(__file__).parent))
        experiments = compose(tree, [], Path("toy.yaml"))
        out = tmp_path_factory.mktemp("report") / "run"
        return run_comparison(experiments, out, workers=2, progress=SilentProgress())
