# SPDX-License-Identifier: Apache-2.0
"""Figures in the style of the thesis; `save` writes the figures of the other functions."""

from screw_module_ros.figure_style import save

from .force_position import force_position, path_views

__all__ = ["force_position", "path_views", "save"]
