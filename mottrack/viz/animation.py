"""Animations: pictures written as a GIF or an MP4."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from mottrack.core.arrays import U8
from mottrack.core.errors import ConfigError, InputError

ENDINGS = (".gif", ".mp4")
GIF_COLOURS = 256  # the most that the format allows
MP4_CODEC = "libx264"
MP4_QUALITY = "20"  # x264's constant rate factor: 18 cannot be told from the original, 28 is small


def write_animation(path: Path, pictures: Iterable[U8], period_s: float) -> int:
    """Write an animation that shows each picture for `period_s`; the path's ending decides how.

    Returns:
        How many pictures it has.

    Raises:
        InputError: the ending is neither .gif nor .mp4, the period is not positive, there is no
            picture, or their sizes differ.
        ConfigError: MP4 is wanted and the package that writes it is not installed.
    """
    if path.suffix.lower() not in ENDINGS:
        raise InputError("ending of the animation", path.name, " or ".join(ENDINGS))
    if not (np.isfinite(period_s) and period_s > 0):
        raise InputError("period_s", period_s, "a positive number of seconds")
    write = _write_gif if path.suffix.lower() == ".gif" else _write_mp4
    counted = _of_one_size(pictures)
    first = next(counted, None)
    if first is None:
        raise InputError("number of pictures", 0, "at least one")
    path.parent.mkdir(parents=True, exist_ok=True)
    return write(path, chain([first], counted), period_s)


def _of_one_size(pictures: Iterable[U8]) -> Iterator[U8]:
    shape = None
    for picture in pictures:
        shape = shape or picture.shape
        if picture.shape != shape:
            raise InputError("size of a picture", picture.shape, f"{shape}, that of the first")
        yield picture


def _write_gif(path: Path, pictures: Iterable[U8], period_s: float) -> int:
    """Write with one palette for all pictures, so that colours do not flicker."""
    images = [Image.fromarray(picture) for picture in pictures]
    palette = _palette([np.asarray(images[k]) for k in (0, len(images) // 2, -1)])
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    duration_ms = round(1000 * period_s)
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=duration_ms, loop=0, optimize=False
    )
    return len(frames)


def _palette(pictures: Sequence[U8]) -> Image.Image:
    """Return a palette of these pictures, each colour weighted by the root of its pixel count.

    By their full count, the greys of a background would leave nothing to small bright things.
    """
    pixels = np.concatenate([picture.reshape(-1, 3) for picture in pictures])
    colours, number = np.unique(pixels, axis=0, return_counts=True)
    sample = np.repeat(colours, np.ceil(np.sqrt(number)).astype(np.int64), axis=0)
    return Image.fromarray(sample[None]).quantize(GIF_COLOURS, dither=Image.Dither.NONE)


def _write_mp4(path: Path, pictures: Iterable[U8], period_s: float) -> int:
    """Write H.264, which every browser plays; its pictures have even heights and widths."""
    av = _pyav()
    count = 0
    with av.open(str(path), "w") as container:
        stream: Any = None
        for picture in pictures:
            even = picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]
            if stream is None:
                stream = container.add_stream(
                    MP4_CODEC, rate=Fraction(1 / period_s).limit_denominator(1000)
                )
                stream.height, stream.width, stream.pix_fmt = *even.shape[:2], "yuv420p"
                stream.options = {"crf": MP4_QUALITY}
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
            container.mux(stream.encode(frame))
            count += 1
        container.mux(stream.encode())
    return count


def _pyav() -> Any:
    try:
        return importlib.import_module("av")
    except ImportError as error:
        raise ConfigError(
            "MP4 needs PyAV: pip install 'mottrack[viz]'; an animation that ends in .gif does not"
        ) from error
