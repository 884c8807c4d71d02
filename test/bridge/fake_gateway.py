# SPDX-License-Identifier: Apache-2.0
"""A robot for the bridge without ROS: topics that are set by hand, calls that are kept."""

from __future__ import annotations

import json

from screw_module_ros.bridge.conversion import ConversionError


class FakeGateway:
    """Keeps what clients do; `tell` publishes."""

    def __init__(self):
        self.published: list[tuple[str, dict]] = []
        self.calls: list[tuple] = []
        self._topics: dict[str, tuple[int, str]] = {}

    def tell(self, topic, content):
        count = self._topics.get(topic, (0, ""))[0] + 1
        self._topics[topic] = (count, json.dumps(content))

    def newest(self, topic):
        return self._topics.get(topic)

    def history(self, topic):
        return [json.dumps({"trial": number}) for number in (1, 2, 3)]

    def publish(self, topic, content):
        if "bad" in content:
            raise ConversionError("bad: unknown field")
        self.published.append((topic, content))

    def call(self, service, arguments, answered):
        if "bad" in arguments:
            raise ConversionError("bad: unknown field")
        self.calls.append((service, arguments, answered))


