"""The command line: each group of verbs is a module; heavy imports wait until they are used."""

from __future__ import annotations

import sys

import typer

from mottrack.cli import data, eval, noise, paper, report, run, train, view

app = typer.Typer(
    name="mottrack",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help comes up in half the time
    help="Multi-object tracking on LiDAR with velocities measured by bird's-eye-view flow.",
)
for group in (run, report, paper, view, eval, data, train, noise):
    group.register(app)

EXIT_USER_ERROR = 2


def main() -> None:
    """Runs a command; an error that the user can mend is one line and exit code 2.

    So is what the file system refuses: a disk that is full, a folder that must not be written.
    """
    from mottrack.core.errors import MottrackError

    try:
        app()
    except MottrackError as error:
        sys.stderr.write(f"mottrack: {error}\n")
        sys.exit(EXIT_USER_ERROR)
    except BrokenPipeError:  # the reader of our output has gone: `mottrack ... | head`
        sys.stderr.close()
        sys.exit(EXIT_USER_ERROR)
    except OSError as error:
        place = "" if error.filename is None else f"{error.filename}: "
        sys.stderr.write(f"mottrack: {place}{error.strerror or type(error).__name__}\n")
        sys.exit(EXIT_USER_ERROR)
