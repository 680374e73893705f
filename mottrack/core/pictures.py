"""Small pictures of boxes and flow for notebooks, as HTML; numpy and the standard library alone."""

from __future__ import annotations

import base64
import html
import struct
import zlib
from collections.abc import Sequence

import numpy as np

from mottrack.core.arrays import F64, U8, Floats
from mottrack.core.pose import rotation_2d

SIDE = 320
"""Pixels of a picture: a third of a notebook's width."""
LEAST_M = 10.0
"""Half the width shown of a single box, so that its size can be told."""
MARGIN = 1.1
"""Factor on what is shown, so that nothing touches the edge."""
TRACK, TRUTH, INK = "#c2410c", "#2e9e5b", "#6b7280"


class Plan:
    """An SVG drawing seen from above: x to the right, y up, in metres."""

    def __init__(self, xy_m: Floats) -> None:
        """Start a drawing that shows the points (N, 2)."""
        known = np.asarray(xy_m, np.float64).reshape(-1, 2)
        known = known if len(known) else np.zeros((1, 2))
        low, high = known.min(axis=0), known.max(axis=0)
        self._centre = (low + high) / 2
        self._reach_m = max(LEAST_M, MARGIN * float((high - low).max()) / 2)
        self._parts: list[str] = []

    def polygon(self, corners_m: Floats, colour: str) -> None:
        """Draw a closed outline (K, 2)."""
        self._parts.append(f'<polygon points="{self._points(corners_m)}" stroke="{colour}"/>')

    def line(self, xy_m: Floats, colour: str) -> None:
        """Draw a path (K, 2)."""
        self._parts.append(f'<polyline points="{self._points(xy_m)}" stroke="{colour}"/>')

    def text(self, at_m: Floats, text: str, colour: str) -> None:
        """Write a short text at a place (2,)."""
        x, y = self._pixels(np.asarray(at_m)[None])[0]
        self._parts.append(
            f'<text x="{x + 3:.1f}" y="{y - 3:.1f}" fill="{colour}" stroke="none" '
            f'font-size="9">{html.escape(text)}</text>'
        )

    def markup(self) -> str:
        """Return the drawing, with a bar for the scale."""
        bar_m = 10 ** np.floor(np.log10(self._reach_m))
        length = bar_m / self._reach_m * SIDE / 2
        scale = (
            f'<path d="M8 {SIDE - 8} h{length:.1f}" stroke="{INK}"/>'
            f'<text x="8" y="{SIDE - 12}" fill="{INK}" stroke="none" font-size="9">{bar_m:g} m'
            "</text>"
        )
        return (
            f'<svg width="{SIDE}" height="{SIDE}" viewBox="0 0 {SIDE} {SIDE}" fill="none" '
            f'stroke-width="1.3" xmlns="http://www.w3.org/2000/svg">{"".join(self._parts)}{scale}'
            "</svg>"
        )

    def _pixels(self, xy_m: Floats) -> F64:
        shifted = (np.asarray(xy_m, np.float64) - self._centre) * (SIDE / 2 / self._reach_m)
        return np.column_stack([SIDE / 2 + shifted[:, 0], SIDE / 2 - shifted[:, 1]])

    def _points(self, xy_m: Floats) -> str:
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in self._pixels(xy_m))


def footprints(centre_m: F64, size_m: F64, yaw_rad: F64) -> list[F64]:
    """Return the corners (4, 2) of each box seen from above."""
    unit = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
    return [
        (unit * size[:2]) @ rotation_2d(yaw).T + centre[:2]
        for centre, size, yaw in zip(centre_m, size_m, yaw_rad, strict=True)
    ]


def png(rgb: U8) -> bytes:
    """Return a picture (H, W, 3) as a PNG file."""
    height, width, _ = rgb.shape
    rows = b"".join(b"\0" + row.tobytes() for row in np.ascontiguousarray(rgb))
    head = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)  # 8 bits a channel, RGB
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(map(_chunk, *zip(*chunks, strict=True)))


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def image(rgb: U8) -> str:
    """Return a picture (H, W, 3), row 0 at the top, as an HTML image."""
    data = base64.b64encode(png(rgb)).decode()
    style = "image-rendering: pixelated"
    return f'<img alt="" width="{SIDE}" style="{style}" src="data:image/png;base64,{data}">'


def captioned(text: str, picture: str) -> str:
    """Return a picture under a line of text."""
    return f"<div><div>{html.escape(text)}</div>{picture}</div>"


def table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], note: str) -> str:
    """Return an HTML table."""

    def line(cells: Sequence[str], kind: str) -> str:
        return f"<tr>{''.join(f'<{kind}>{html.escape(cell)}</{kind}>' for cell in cells)}</tr>"

    body = "".join(line(row, "td") for row in rows)
    small = f"<small>{html.escape(note)}</small>" if note else ""
    caption = f"<caption>{html.escape(title)}</caption>"
    return f"<table>{caption}<thead>{line(head, 'th')}</thead><tbody>{body}</tbody></table>{small}"
