# SPDX-License-Identifier: Apache-2.0
"""`python -m screw_module_ros.recording`: the same as the command `session`."""

import sys

from .cli import main

sys.exit(main())
