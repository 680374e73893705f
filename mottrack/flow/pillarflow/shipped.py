"""Where weights are: those that come with the package, or a file of the user's."""

from __future__ import annotations

from pathlib import Path

from mottrack.core.errors import DataError

SHIPPED = Path(__file__).parent / "weights"


def weights_path(name: str) -> Path:
    """File of shipped weights, or `name` itself if it is a path to a safetensors file.

    Raises:
        DataError: no weights of that name are shipped.
    """
    if name.endswith(".safetensors"):
        return Path(name)
    file = SHIPPED / f"{name}.safetensors"
    if not file.exists():
        shipped = sorted(path.stem for path in SHIPPED.glob("*.safetensors"))
        raise DataError(file, "weights", "absent", f"one of {shipped} or a .safetensors file")
    return file
