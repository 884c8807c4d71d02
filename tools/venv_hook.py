# SPDX-License-Identifier: Apache-2.0
"""Makes the virtual environment's Python find the built packages; nothing needs to be sourced.

`make build` copies this file into the environment, where a `.pth` file imports it at each start of
Python, before the ROS wheels' own bootstrap (by name order). It adds the colcon prefixes and, with
wheels, the environment itself to AMENT_PREFIX_PATH, sys.path and LD_LIBRARY_PATH. The dynamic
loader reads LD_LIBRARY_PATH only when a process starts, so Python is started again, once, when
that one lacked something. The wheels do the same, but judge by a flag that children inherit even
when their LD_LIBRARY_PATH is another one; here the path itself decides.
"""

import glob
import os
import sys

PACKAGES = ("screw_module_ros", "screw_module_msgs")
RESTARTED = "_SCREW_MODULE_RESTARTED_PID"  # the restart keeps the process id, a child has another
WHEELS_DONE = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
# These work out the variables for others, from those they are given: colcon, its setup scripts.
LEFT_ALONE = ("colcon", "_local_setup_util_sh.py")


def prepend(name, entries):
    """Put the entries that are not there yet before the variable's others; True when any was."""
    old = [entry for entry in os.environ.get(name, "").split(os.pathsep) if entry]
    missing = [entry for entry in entries if entry not in old]
    if missing:
        os.environ[name] = os.pathsep.join(missing + old)
    return bool(missing)


def set_up(venv):
    """Set the variables and sys.path for `venv`; restart Python when the loader needs it."""
    root = os.path.dirname(venv)
    site_packages = os.path.join("lib", "python%d.%d" % sys.version_info[:2], "site-packages")
    built = [os.path.join(root, "install", package) for package in PACKAGES]
    built = [prefix for prefix in built if os.path.isdir(prefix)]
    libraries = [os.path.join(prefix, "lib") for prefix in built]
    modules = [os.path.join(prefix, site_packages) for prefix in built]
    # colcon's --symlink-install leaves the package's metadata in its build folder
    modules.append(os.path.join(root, "build", PACKAGES[0]))
    wheels = os.path.isdir(os.path.join(venv, "share", "rclpy"))
    if wheels:
        libraries.append(os.path.join(venv, "lib"))
        libraries += sorted(glob.glob(os.path.join(venv, site_packages, "ros_*.libs")))
        os.environ[WHEELS_DONE] = "1"
    prepend("AMENT_PREFIX_PATH", built + ([venv] if wheels else []))
    sys.path += [path for path in modules if os.path.isdir(path) and path not in sys.path]
    restart = prepend("LD_LIBRARY_PATH", libraries)
    if restart and os.environ.get(RESTARTED) != str(os.getpid()):
        os.environ[RESTARTED] = str(os.getpid())
        os.execv(sys.executable, [sys.executable] + sys.orig_argv[1:])


if not any(os.path.basename(argument) in LEFT_ALONE for argument in sys.orig_argv[1:3]):
    set_up(sys.prefix)
