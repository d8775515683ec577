"""A ROS domain that no other run on this machine uses."""

from __future__ import annotations

import itertools
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from snnav_core.errors import SnnavError

__all__ = ["free_domain"]

_DOMAINS = 100  # 1 to 100: their ports lie below the range that Linux gives out by itself


@contextmanager
def free_domain() -> Iterator[int]:
    """Provide the number of a domain: that of ROS_DOMAIN_ID if it is set, else one that is held until the end.

    Raises
    ------
    SnnavError
        If ROS_DOMAIN_ID is no number from 0 to 232, or all domains are held.
    """
    given = os.environ.get("ROS_DOMAIN_ID", "")
    if given:
        if not (given.isdecimal() and int(given) <= 232):
            raise SnnavError(
                f"ROS_DOMAIN_ID is {given!r}, must be a number from 0 to 232; correct or unset it"
            )
        yield int(given)
        return
    for offset in itertools.islice(itertools.count(os.getpid()), _DOMAINS):
        domain = offset % _DOMAINS + 1
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            lock.bind(f"\0snnav-domain-{domain}")  # an abstract name: it goes with the process
        except OSError:
            lock.close()
            continue
        with lock:
            yield domain
        return
    raise SnnavError(f"all ROS domains from 1 to {_DOMAINS} are held by other runs; set ROS_DOMAIN_ID")
