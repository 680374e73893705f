"""The number of torch's threads survives the start of numba's."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import numba, torch
from mottrack.flow.pillarflow.cost_volume import cost_volume
from mottrack.flow.pillarflow.engine import use_threads
use_threads({count})
before = torch.get_num_threads()
cost_volume(torch.ones(1, 4, 8, 8), torch.ones(1, 4, 8, 8), 1)
print(before, torch.get_num_threads())
"""


def test_starting_numbas_threads_leaves_torch_alone() -> None:
    script = SCRIPT.format(count=3)
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["3", "3"]
