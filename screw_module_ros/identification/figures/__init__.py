# SPDX-License-Identifier: Apache-2.0
"""Figures in the manner of the thesis's; `save` writes what the other functions return."""

from .force_position import force_position, path_3d
from .style import save

__all__ = ["force_position", "path_3d", "save"]
