# SPDX-License-Identifier: Apache-2.0
"""A recorder for `therapy_session` that is played by a test."""

from __future__ import annotations

from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.task import Future
from screw_module_msgs.srv import StartRecording


class PlayedRecorder:
    """The services of a recorder, which answer when the test says so; also node and inbox."""

    def __init__(self):
        self.asked: dict[str, list[Future]] = {}
        self.names: list[str] = []
        self.told: list[DiagnosticStatus] = []
        log = SimpleNamespace(info=lambda text: None, warning=lambda text: None)
        self.get_logger = lambda: log
        self.get_namespace = lambda: "/"
        self.resolve_topic_name = "/{}".format
        self.left_out: set[str] = set()
        self.is_there = True

    def create_client(self, kind, name):
        calls = self.asked[name.rpartition("/")[2]] = []

        def call_async(request):
            self.names += [request.name] if isinstance(request, StartRecording.Request) else []
            calls.append(Future())
            return calls[-1]

        return SimpleNamespace(call_async=call_async)

    def get_subscriptions_info_by_topic(self, name):
        other = SimpleNamespace(node_name="web_bridge", node_namespace="/")
        own = SimpleNamespace(node_name="session_recorder", node_namespace="/")
        return [other] if name in self.left_out else [other, own]

    def subscribe(self, kind, name, profile):
        return lambda: self.told.pop(0) if self.told else None

    def answer(self, service, response):
        """Answer the oldest call."""
        self.asked[service].pop(0).set_result(response)

    def report(self, recording, bag="", message="", **more):
        said = {"recording": str(recording), "bag": bag, **more}
        values = [KeyValue(key=key, value=value) for key, value in said.items()]
        self.told.append(DiagnosticStatus(values=values, message=message))
