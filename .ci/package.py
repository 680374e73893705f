"""`make package`: build sdist and wheel, compare them with the repository, install and use each."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"
ENVIRONMENT = ROOT / ".venv-package"
MADE = {"PKG-INFO"}
"""What the build adds to the sdist."""
INFO = ".dist-info/"


def main() -> None:
    """Build and use both archives; raise at the first difference."""
    files = repository()
    size = sum(len(content) for content in files.values())
    say(f"repository: {len(files)} files, {size / 1e6:.1f} MB")
    shutil.rmtree(DIST, ignore_errors=True)
    with clock("build sdist, and wheel from it"):
        run(sys.executable, "-m", "build", "--outdir", DIST, ROOT, quiet=True)
    sdist, wheel = next(DIST.glob("*.tar.gz")), next(DIST.glob("*.whl"))
    packed = members(wheel)
    same({n: c for n, c in members(sdist).items() if n not in MADE}, files, sdist.name)
    same({n: c for n, c in packed.items() if INFO not in n}, in_a_wheel(files), wheel.name)
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "build", "--wheel", "--outdir", folder, ROOT, quiet=True)
        same(members(next(Path(folder).glob("*.whl"))), packed, "the wheel of the repository")
    python = fresh_environment()
    for archive in (wheel, sdist):
        say(f"{archive.name}: {archive.stat().st_size / 1e6:.1f} MB")
        use(archive, in_a_wheel(files), python)


def repository() -> dict[str, bytes]:
    """Return the content of every file of the repository, the links at its top apart."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    paths = [n for n in names.split("\0") if n and not (ROOT / n).is_symlink()]
    return {name: (ROOT / name).read_bytes() for name in paths if (ROOT / name).is_file()}


def in_a_wheel(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files that are installed: the package, and the configurations inside it."""
    package = {n: c for n, c in files.items() if n.startswith("mottrack/")}
    return package | {f"mottrack/{n}": c for n, c in files.items() if n.startswith("configs/")}


def members(archive: Path) -> dict[str, bytes]:
    """Return the content of every file of a wheel or, without its top folder, of an sdist."""
    if archive.suffix == ".whl":
        with zipfile.ZipFile(archive) as wheel:
            return {name: wheel.read(name) for name in wheel.namelist()}
    with tarfile.open(archive) as sdist:
        found = [(m, sdist.extractfile(m)) for m in sdist.getmembers()]
        return {m.name.partition("/")[2]: f.read() for m, f in found if f is not None}


def same(have: Mapping[str, bytes], want: Mapping[str, bytes], what: str) -> None:
    """Raise SystemExit where a file is missing, foreign or different."""
    wrong = [n for n in sorted({*have, *want}) if have.get(n) != want.get(n)]
    if wrong:
        raise SystemExit(f"{what}: {len(wrong)} files are missing, foreign or differ: {wrong[:10]}")
    say(f"{what}: {len(have)} files, complete")


def fresh_environment() -> Path:
    """Return the interpreter of a new environment that holds torch alone, as `make` installs it."""
    run(sys.executable, "-m", "venv", "--clear", ENVIRONMENT)
    python = ENVIRONMENT / "bin" / "python"
    with clock("install torch"):
        pip(python, "install", "-c", ROOT / "constraints.txt", "torch==2.13.0")
    return python


def use(archive: Path, files: Mapping[str, bytes], python: Path) -> None:
    """Install an archive, run the demo away from the repository, and remove it again."""
    with clock(f"install {archive.name}"):
        pip(python, "install", "-c", ROOT / "constraints.txt", archive)
    site = next(ENVIRONMENT.glob("lib/python*/site-packages"))
    installed = {n: (site / n).read_bytes() for n in files if (site / n).is_file()}
    same(installed, files, "installed")
    with tempfile.TemporaryDirectory() as folder, clock("mottrack demo --quick"):
        run(python.parent / "mottrack", "demo", "--quick", cwd=Path(folder))
        assert (Path(folder) / "out/demo/report.html").stat().st_size  # noqa: S101
    pip(python, "uninstall", "-y", "mottrack")
    left = [path for path in site.glob("mottrack*/**/*") if path.is_file()]
    # numba's cache, which pip does not know: the second demo is spared the compilation
    foreign = [str(path) for path in left if path.suffix not in (".nbi", ".nbc")]
    if foreign:
        raise SystemExit(f"pip uninstall leaves {foreign[:10]}")


def pip(python: Path, *words: str | Path) -> None:
    """Run pip of an environment."""
    run(python, "-m", "pip", words[0], "-q", *words[1:])


def run(*words: str | Path, cwd: Path = ROOT, quiet: bool = False) -> None:
    """Run a command, with no variable that could lead it to the repository; raise if it fails."""
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "NUMBA_CACHE_DIR")}
    out, error = (subprocess.PIPE, subprocess.STDOUT) if quiet else (None, None)
    command = list(map(str, words))
    done = subprocess.run(command, cwd=cwd, env=kept, stdout=out, stderr=error, text=True)
    if done.returncode:
        said = done.stdout or ""
        raise SystemExit(f"{' '.join(command)}: exit code {done.returncode}\n{said}")


@contextmanager
def clock(what: str) -> Iterator[None]:
    """Print how long something took, and the processor time of the commands that it ran."""
    start, before = time.monotonic(), os.times()
    yield
    after = os.times()
    used = sum(after[2:4]) - sum(before[2:4])  # of child processes: user, system
    say(f"{what}: {time.monotonic() - start:.0f} s, processor {used:.0f} s")


def say(line: str) -> None:
    """Print a line at once, in order with what the commands print."""
    print(f"package: {line}", flush=True)


if __name__ == "__main__":
    main()
