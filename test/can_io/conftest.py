# SPDX-License-Identifier: Apache-2.0
"""Fixtures for the buses: the scripted far end of the drivers' tests."""

from __future__ import annotations

from scripted_fixtures import encoder_end, wire  # noqa: F401
