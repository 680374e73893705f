"""What a log makes py123d do before its content is read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa

from mottrack.core.errors import DataError

_BOXES = "box_detections_se3.arrow"
_LABELS = "box_detection_label_class"
_METADATA = b"metadata"


def require_own_labels(folder: Path) -> None:
    """Refuse a log that names a module of somebody else for its labels: py123d imports it.

    Raises:
        DataError: damaged file, or such a name.
    """
    import msgpack  # comes with py123d

    path = folder / _BOXES
    if not path.is_file():
        return
    try:
        with pa.memory_map(str(path), "r") as source:
            metadata = pa.ipc.open_file(source).schema.metadata or {}
        content: Any = msgpack.unpackb(metadata.get(_METADATA, b"\x80"), raw=False)
    except (pa.ArrowException, OSError, ValueError, msgpack.UnpackException) as error:
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
        raise DataError(path, "content", f"unreadable ({reason})", "an Arrow file") from error
    name = content.get(_LABELS, "") if isinstance(content, dict) else ""
    if not isinstance(name, str) or ("." in name and not name.startswith("py123d.")):
        raise DataError(path, _LABELS, name, "a list of labels of py123d")
