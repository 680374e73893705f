"""D: hostile input."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

from mottrack.flow.pillarflow.source import SHIPPED
from mottrack.flow.pillarflow.weights_file import load_weights
from mottrack.formats.text_table import Column, TextTable, to_csv, to_latex, to_markdown
from tests.fuzz.faults.finished import stranger
from tests.fuzz.faults.printed import (
    Faults,
    bomb,
    changed,
    experiment,
    raised,
    replaced,
    weights,
)


def one_weight(root: Path) -> object:
    """One weight of 3e22, of the right type and shape."""
    data = bytearray((SHIPPED / "small.safetensors").read_bytes())
    size = int.from_bytes(data[:8], "little")
    first = json.loads(data[8 : 8 + size])["encoder.linear.weight"]["data_offsets"][0]
    struct.pack_into("<f", data, 8 + size + first, np.float32(3e22))
    path = root / "weights.safetensors"
    path.write_bytes(data)
    load_weights(path)
    return None


def in_tables(_root: Path) -> str:
    """A name with control characters in each format of a table."""
    table = TextTable("t", "T", (Column("name"),), (("car\x1b[31m",),))
    lines = [line for text in (to_csv, to_markdown, to_latex) for line in text(table).splitlines()]
    return "accepted: " + "; ".join(line for line in lines if "x1b" in line)


def laughs(levels: int, times: int) -> str:
    """YAML of few aliases whose values are many once they are written out."""
    more = [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * times)}]" for k in range(1, levels)]
    return "\n".join(["a0: &a0 [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]", *more])


FAULTS: Faults = {
    "D1 YAML with 40 aliases that expand to gigabytes": experiment(laughs(9, 5)),
    "D1 YAML with 58 aliases": experiment(laughs(30, 2)),
    "D2 a run folder from a stranger with `tracker: {kind: 'evil_mod:X'}`": stranger,
    "D3 weights whose header asks for `convs_per_level: 1000000000`": weights(
        'convs_per_level\\":', 'convs_per_level\\":1000000000,\\"other\\":'
    ),
    'D3 weights with `"F32"` changed to `"I32"`': weights('"F32"', '"I32"'),
    "D3 one weight of 3e22": raised(one_weight),
    "D4 a zstd feather of 60 million points": changed("argoverse2 sweep", bomb),
    "D5 control characters in a label": replaced("own detections", ",car,", ",\x1b[2J,", 1),
    "D5 the same in csv, md and tex": in_tables,
    "D5 a long name of a class": replaced(
        "nuscenes detections", '"car"', json.dumps("\x1b[2J" + 3000 * "x"), 1
    ),
}
