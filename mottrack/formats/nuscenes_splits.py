"""The official nuScenes splits, as ranges of scene numbers.

Held here so that no devkit is needed; the oracle tests compare them with nuscenes-devkit 1.2.0.
"""

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from mottrack.core.errors import DataError, unknown_name
from mottrack.formats.text_rows import read_lines

_RANGES = {
    "train_detect": (
        "1-2 41-76 161-168 170-176 190-196 199-200 202-204 206-214 254-264 283-306 315-318 321 "
        "323-324 347-375 382 420-439 457-459 461-465 467-469 471-472 474-480 566 568 570-578 "
        "580 582-583 665-679 681 683-689 739-741 744 746-747 749-752 757-765 767-769 868-873 "
        "875-878 880 882-903 945 947 949 952-953 955-961 975-984 988-991 1011-1025 1074-1102 "
        "1104-1105"
    ),
    "train_track": (
        "4-11 19-34 120-135 138-139 149-152 154-155 157-160 177-185 187-188 218-220 222 224-253 "
        "328 376-381 383-386 388-403 405-408 410-419 440-456 499-502 504-515 517-518 525-539 "
        "541-546 584-600 639-664 695-698 700-701 703-719 726-728 730-731 733-738 786-787 "
        "789-792 803-806 808-813 815-817 819-822 847-856 858 860-866 992 994-1010 1044-1058 "
        "1106-1110"
    ),
    "val": (
        "3 12-18 35-36 38-39 92-110 221 268-278 329-332 344-346 519-524 552-565 625-627 629-630 "
        "632-638 770-771 775 777-778 780-784 794-800 802 904-917 919-931 962-963 966-969 "
        "971-972 1059-1073"
    ),
    "test": (
        "77-91 111-119 140 142-148 265-266 279-282 307-314 333-343 481-498 547-551 601-604 "
        "606-624 827-831 833-842 844-846 932-933 935-943 1026-1043"
    ),
    "mini_train": ("61 553 655 757 796 1077 1094 1100"),
    "mini_val": ("103 916"),
}
_UNIONS = {"train": ("train_detect", "train_track")}

SPLITS: tuple[str, ...] = ("train", *_RANGES)


def split_scenes(split: str) -> tuple[str, ...]:
    """Return the scene names of an official split, in ascending order.

    Raises:
        ConfigError: no split has that name.
    """
    if split not in SPLITS:
        raise unknown_name("split", split, SPLITS)
    numbers = sorted(n for part in _UNIONS.get(split, (split,)) for n in _expand(_RANGES[part]))
    return tuple(f"scene-{n:04d}" for n in numbers)


def resolve_split(split: str) -> tuple[str, ...]:
    """Return the scene names of an official split, or those listed in a text file, one a line.

    Blank lines and lines starting with # are skipped.

    Raises:
        ConfigError: neither a split nor a file has that name.
        DataError: the file holds no names.
    """
    return resolve_names(split, {name: split_scenes(name) for name in SPLITS})


def resolve_names(split: str, splits: Mapping[str, Collection[str]]) -> tuple[str, ...]:
    """Return the scene names of one of the splits, or those listed in a text file.

    Raises:
        ConfigError: neither a split nor a file has that name.
        DataError: the file holds no names.
    """
    path = Path(split)
    if split in splits:
        return tuple(splits[split])
    if not path.is_file():
        raise unknown_name("split", split, [*splits, "a text file of scene names"])
    lines = (line.strip() for line in read_lines(path))
    names = tuple(line for line in lines if line and not line.startswith("#"))
    if not names:
        raise DataError(path, "scene names", "none", "one scene name a line")
    return names


def splits_of(scenes: Iterable[str]) -> dict[str, int]:
    """Return how many of the scenes each official split holds, without those that hold none."""
    wanted = set(scenes)
    counts = {split: len(wanted.intersection(split_scenes(split))) for split in SPLITS}
    return {split: count for split, count in counts.items() if count}


def best_split(scenes: Collection[str]) -> str | None:
    """Return the smallest official split that holds all the scenes, or None."""
    holding = [name for name, count in splits_of(scenes).items() if count == len(set(scenes))]
    return min(holding, key=lambda name: len(split_scenes(name)), default=None)


def _expand(ranges: str) -> list[int]:
    numbers: list[int] = []
    for part in ranges.split():
        first, _, last = part.partition("-")
        numbers.extend(range(int(first), int(last or first) + 1))
    return numbers
