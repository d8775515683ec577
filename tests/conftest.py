"""What all tests share: Hypothesis profiles, and a ROS domain of its own for every test that may use ROS."""

from __future__ import annotations

import itertools
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

pytest.register_assert_rewrite("support")

_ROS_FOLDERS = ("ros", "system")
_DOMAINS = 100  # domains 1 to 100: their ports lie below the range that Linux gives out by itself
_next_domain = itertools.count(
    os.getpid()
)  # the next test takes another one: nothing of the last test is heard

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

_COMMON = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("local", max_examples=50, **_COMMON)
settings.register_profile("ci", max_examples=50, derandomize=True, **_COMMON)
settings.register_profile("nightly", max_examples=500, **_COMMON)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE") or ("ci" if os.environ.get("CI") else "local"))


def _reserve_domain() -> tuple[int, socket.socket]:
    """Return a ROS domain that no other test process on this machine holds, and the lock that holds it."""
    for number in itertools.islice(_next_domain, _DOMAINS):
        domain = number % _DOMAINS + 1
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            lock.bind(f"\0snnav-test-domain-{domain}")
        except OSError:
            lock.close()
        else:
            return domain, lock
    raise RuntimeError(f"all ROS domains from 1 to {_DOMAINS} are in use by tests")


@pytest.fixture(autouse=True)
def ros_domain(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[int | None]:
    """Give every test under tests/ros and tests/system its own ROS_DOMAIN_ID."""
    folder = Path(request.path).relative_to(Path(__file__).parent).parts[0]
    if folder not in _ROS_FOLDERS:
        yield None
        return
    domain, lock = _reserve_domain()
    with lock:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        yield domain
