# SPDX-License-Identifier: Apache-2.0
"""Fixtures for the drivers: a virtual bus whose far end answers inside each send, so no waiting."""

from __future__ import annotations

from scripted_fixtures import wire  # noqa: F401
