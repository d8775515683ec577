"""A ROS of its own for every test: context, executor, nodes and ears."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile

from snnav_ros.available import make_executor
from snnav_ros.nodes.base import NodeOptions

_LONGEST = 20.0  # [s] that anything may take before a test fails


class Graph:
    """Nodes under test in one executor, beside a plain node that speaks and listens for the test."""

    def __init__(self, domain: int) -> None:
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.executor = make_executor(self.context)
        self.probe = Node("probe", context=self.context, enable_rosout=False, start_parameter_services=False)
        self.executor.add_node(self.probe)
        self.nodes: list[Any] = [self.probe]

    def add(self, kind: Any, name: str | None = None, *, lean: bool = True, **parameters: Any) -> Any:
        """Make a node with parameters and let it work."""
        node = kind(NodeOptions(name, parameters, self.context, lean))
        self.executor.add_node(node)
        self.nodes.append(node)
        return node

    def hear(self, kind: Any, topic: str, qos: QoSProfile | int = 100) -> list[Any]:
        """Return a list that fills with the messages of a topic."""
        heard: list[Any] = []
        self.probe.create_subscription(kind, topic, heard.append, qos)
        return heard

    def speak(self, kind: Any, topic: str, qos: QoSProfile | int = 10, listeners: int = 1) -> Any:
        """Return a publisher that somebody hears."""
        publisher = self.probe.create_publisher(kind, topic, qos)
        self.until(lambda: publisher.get_subscription_count() >= listeners, f"a listener of {topic}")
        return publisher

    def call(self, kind: Any, service: str, request: Any) -> Any:
        client = self.probe.create_client(kind, service)
        self.until(client.service_is_ready, f"service {service}")
        future = client.call_async(request)
        self.until(future.done, f"answer of {service}")
        return future.result()

    def until(
        self, condition: Callable[[], bool], what: str = "the condition", longest: float = _LONGEST
    ) -> None:
        """Work until something holds."""
        end = time.monotonic() + longest
        while not condition():
            assert time.monotonic() < end, f"waited {longest} s for {what}"
            self.executor.spin_once(timeout_sec=0.05)

    def work(self, seconds: float) -> None:
        """Work for a while of wall time, to see that something does not happen."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def close(self) -> None:
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)


@pytest.fixture
def graph(ros_domain: int) -> Iterator[Graph]:
    made = Graph(ros_domain)
    try:
        yield made
    finally:
        made.close()
