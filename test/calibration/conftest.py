# SPDX-License-Identifier: Apache-2.0
"""Hypothesis without its deadline per example: how long something takes is no property of a law."""

from hypothesis import settings

settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")
