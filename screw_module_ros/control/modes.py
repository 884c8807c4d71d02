# SPDX-License-Identifier: Apache-2.0
"""Control modes of the vertical axis: the constants of screw_module_msgs/ForceCommand.

`laws` says which law has which mode; EXCITATION, the sine of a trial on a lease, is no law.
"""

from __future__ import annotations

OFF = 0
IMPEDANCE = 1
FRICTION_COMPENSATION = 2
FORCE_FEEDBACK = 3
COMBINED = 4
OBSERVER = 5
EXCITATION = 6
