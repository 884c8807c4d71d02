# SPDX-License-Identifier: Apache-2.0
"""Calls a service of a node in this process, as its service thread does for a client."""

from __future__ import annotations

from typing import Any


def served(node: Any, name: str) -> Any:
    """Return the node's service of this name, as the node offers it: `~/home`."""
    return next(service for service in node.services if service.srv_name == name)


def asked(node: Any, name: str, request: Any = None) -> Any:
    """Return the response of the node's service; request: an empty one by default."""
    service = served(node, name)
    kind = service.srv_type
    return service.callback(request or kind.Request(), kind.Response())


def activate(node: Any) -> None:
    """Make a node active that has no devices here."""
    node.connect = node.begin = lambda: None
    node.trigger_configure()
    node.trigger_activate()
    assert node.active
