"""The `snnav` command; ROS is imported only by what needs it."""

from __future__ import annotations

import argparse
import errno
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any

from snnav_core.errors import SnnavError

__all__ = ["main"]

_PROGRAM = "snnav"
_MISTAKE, _INTERRUPTED = 2, 130
_REMEDIES = {  # what the machine may refuse anywhere
    **dict.fromkeys((errno.EACCES, errno.EPERM, errno.EROFS), "give a place that you may read and write"),
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), "make room, or give another place"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Parameters
    ----------
    arguments : sequence of str, optional
        ``sys.argv`` without the program by default.

    Returns
    -------
    int
        Exit status: 0, or what the command says; 2 after a mistake of the user, told in one line on stderr; 130
        after Ctrl-C.
    """
    signal.signal(signal.SIGTERM, _interrupt)
    signal.signal(signal.SIGINT, _interrupt)  # a shell starts background programs with this one ignored
    try:
        chosen = _parser().parse_args(arguments)
        status: int = chosen.func(chosen)
    except KeyboardInterrupt:
        print(f"{_PROGRAM}: interrupted", file=sys.stderr)
        return _INTERRUPTED
    except SnnavError as error:
        print(f"{_PROGRAM}: {error}", file=sys.stderr)
        return _MISTAKE
    except BrokenPipeError:  # the reader of the output has gone, for example `head`
        sys.stderr.close()
        return 0
    except OSError as error:
        if error.errno not in _REMEDIES:
            raise
        place = "" if error.filename is None else f"{error.filename}: "
        print(f"{_PROGRAM}: {place}{error.strerror}; {_REMEDIES[error.errno]}", file=sys.stderr)
        return _MISTAKE
    return status


def _interrupt(*_: Any) -> None:
    raise KeyboardInterrupt


class _Parser(argparse.ArgumentParser):
    """Tells a mistake in one line."""

    def error(self, message: str) -> Any:
        """Print one line and leave with status 2."""
        self.exit(_MISTAKE, f"{self.prog}: {message}; see {self.prog} --help\n")


def _parser() -> argparse.ArgumentParser:
    from snnav_ros.bag.commands import add_parser as add_recordings
    from snnav_ros.campaign_command import add_parsers as add_campaigns
    from snnav_ros.coverage_command import add_parsers as add_coverage
    from snnav_ros.run_command import add_parsers as add_runs

    registry: tuple[Callable[[Any], None], ...] = (add_runs, add_coverage, add_campaigns, add_recordings)
    parser = _Parser(
        prog=_PROGRAM, description="Navigation of mobile robots through a network of range finders."
    )
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for add in registry:
        add(subparsers)
    return parser


if __name__ == "__main__":
    sys.exit(main())
