"""What the times of Table V were measured on, kept beside the results."""

from __future__ import annotations

import json
import os
import platform
from pathlib import Path

from mottrack.core.storage import write_text

NOTE = "machine.json"


def note_machine(folder: Path) -> None:
    """Adds this machine to those on which the results in a folder were timed."""
    known = machines(folder)
    mine = _machine()
    write_text(folder / NOTE, json.dumps([*(m for m in known if m != mine), mine], indent=1) + "\n")


def machines(folder: Path) -> list[str]:
    """What the results in a folder were timed on, a text each; none where nobody noted it."""
    path = folder / NOTE
    return [str(text) for text in json.loads(path.read_text())] if path.is_file() else []


def _machine() -> str:
    import torch

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    device = torch.cuda.get_device_name(0) if torch.cuda.is_available() else "no GPU"
    load = f"; load {os.getloadavg()[0]:.1f} at the end" if hasattr(os, "getloadavg") else ""
    return f"{_processor()}, {cores} cores, {device}{load}"


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
