# SPDX-License-Identifier: Apache-2.0
"""Type and quality of service of the graph's topics: ROS objects for the names in `graph.py`.

For `ModuleNode.outlet` and `Inbox.subscribe`::

    self.outlet(*offered(graph.JOINT_STATES))
    inbox.subscribe(*requested(graph.SETPOINT))
"""

from __future__ import annotations

import importlib
from typing import Any

from rclpy.qos import QoSProfile

from screw_module_ros.graph import TOPICS

from . import qos
from .flat import FLAT, Flat

_OFFERED = {"sample": qos.SAMPLE, "command": qos.COMMAND, "state": qos.STATE}
_REQUESTED = {"sample": qos.SAMPLE, "command": qos.COMMAND, "state": qos.NEWEST}


def message_class(type_name: str) -> Any:
    """Return the class of `package/msg/Name` or of an action's feedback.

    Raises ImportError, AttributeError where it is not installed.
    """
    package, folder, name = type_name.split("/")
    module = importlib.import_module(f"{package}.{folder}")
    if folder == "action":
        return getattr(module, name.removesuffix("_FeedbackMessage")).Impl.FeedbackMessage
    return getattr(module, name)


def offered(topic: str) -> tuple[Any, str, QoSProfile]:
    """Return message class, name and quality of service of a topic, for its publisher."""
    _, type_name, quality, *_ = TOPICS[topic]
    return message_class(type_name), topic, _OFFERED[quality]


def requested(topic: str, profile: QoSProfile | None = None) -> tuple[Any | Flat, str, QoSProfile]:
    """Return class or record, name and quality of service for a hot loop's subscription.

    profile: replaces the default one, which keeps only the newest message.
    """
    _, type_name, quality, *_ = TOPICS[topic]
    kind = message_class(type_name)
    return FLAT.get(kind, kind), topic, profile or _REQUESTED[quality]
