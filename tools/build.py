# SPDX-License-Identifier: Apache-2.0
"""`make build`: from a fresh clone to installed packages; what is done already is skipped.

Virtual environment, tools and ROS, screw_module_msgs, beside it the packages that nodes import, and
screw_module_ros: each step leaves a stamp, a hash of what went in, and is done again when that
changed. With ROS 2 Jazzy sourced the ROS wheels fall away. Standard library only.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import packages
import parsed_idl
import prerequisites
import ros_wheels
import shebangs
from steps import Progress, Step, StepFailed, run_all, run_logged

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin/python"
BUILD, INSTALL = ROOT / "build", ROOT / "install"
LOGS = BUILD / "log"
UNFINISHED = ".unfinished-"  # begins the names of marks that are there while packages come
REQUIREMENTS = ROOT / "requirements"
MESSAGES, PACKAGE = "screw_module_msgs", "screw_module_ros"
HOOK = "_screw_module_ros_env"  # must sort before ros_wheels_bootstrapper
STEPS = 5


def main() -> int:
    """Run the steps that are needed; return the exit code."""
    started = time.monotonic()
    os.chdir(ROOT)  # where colcon looks for its defaults, and what the logs' names are relative to
    try:
        prerequisites.check_python()
        ros = prerequisites.ros_prefix()
        prerequisites.check_path(ROOT, ros)
        prerequisites.check_compiler()
        if ros is None:
            prerequisites.check_wheels_fit()
        with only_one_build():
            worked = build(ros, Progress(STEPS))
    except (prerequisites.Missing, StepFailed) as error:
        print(f"make build: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nmake build: stopped; run it again to go on from here", file=sys.stderr)
        return 130
    if worked:
        source = f"the ROS 2 Jazzy in {ros}" if ros else "the ROS 2 Jazzy wheels"
        print(f"Built with {source} in {time.monotonic() - started:.0f} s.")
    return 0


def build(ros: Path | None, progress: Progress) -> bool:
    """Do the steps whose stamp does not fit; return whether there was any."""
    steps = plan(ros)
    if all(step.fits() for step in steps):
        return False
    prerequisites.check_disk(ROOT)
    if any(VENV.glob(f"{UNFINISHED}*")):  # a package may lack files that its metadata promises
        shutil.rmtree(VENV)
    run_all(steps, progress)
    return True


def plan(ros: Path | None) -> list[Step]:
    """Return the steps from a fresh clone to installed packages, with the stamps of today."""
    environment = digest([str(ROOT), sys.version, str(ros)])
    tools, imports = tool_lists(ros), import_lists()
    builders = tools[2:]
    definitions = sorted(file for file in (ROOT / "msg_defs").rglob("*") if file.is_file())
    described = [ROOT / name for name in ("setup.py", "setup.cfg", "package.xml")]
    hooks = [ROOT / "tools/venv_hook.py", ROOT / "tools/parsed_idl.py"]
    return [
        Step("virtual environment", VENV, environment, lambda _: make_venv(ros)),
        Step(
            "build tools" if ros else "build tools and ROS",
            VENV / "bin",
            digest([environment], [*tools, *hooks]),
            lambda progress: install_tools(tools, ros, progress),
        ),
        Step(
            MESSAGES,
            INSTALL / MESSAGES,
            digest([environment], builders + definitions),
            lambda progress: colcon(MESSAGES, ros, progress),
        ),
        Step(
            "packages to import",
            VENV / "lib",
            digest([environment], imports),
            lambda progress: install_imports(imports, progress),
            beside=True,  # the messages need no more than the tools
        ),
        Step(
            PACKAGE,
            INSTALL / PACKAGE,
            digest([environment, *data_files()], builders + described),
            lambda progress: install_nodes(ros, progress),
        ),
    ]


def make_venv(ros: Path | None) -> None:
    """Make the virtual environment anew; what was built with an older one goes with it."""
    for folder in (VENV, BUILD / MESSAGES, BUILD / PACKAGE, INSTALL):
        shutil.rmtree(folder, ignore_errors=True)
    options = ["--system-site-packages"] if ros else []
    command = [prerequisites.interpreter(), "-m", "venv", *options, str(VENV)]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode != 0:
        raise StepFailed(f"python -m venv failed: {(made.stderr or made.stdout).strip()}")


def install_tools(lists: list[Path], ros: Path | None, progress: Progress) -> None:
    """Install what builds, and ROS; then the hook that makes Python find what is built."""
    log = LOGS / "tools.log"
    with unfinished("tools"):
        log.unlink(missing_ok=True)
        packages.get_uv(PYTHON, lists[0], log, progress)
        packages.install(PYTHON, lists[1:2], log, progress)  # the source package is built with it
        packages.install(PYTHON, lists[2:], log, progress)
        if ros is None:
            ros_wheels.rewrite_cmake_files(VENV)
            ros_wheels.parse_once(site_packages())
        packages.compile_bytecode(PYTHON, site_packages(), log, progress)
        shutil.copy(ROOT / "tools/venv_hook.py", site_packages() / f"{HOOK}.py")
        (site_packages() / f"{HOOK}.pth").write_text(f"import {HOOK}\n")


def install_imports(lists: list[Path], progress: Progress) -> None:
    """Install what the nodes, the tests and the lint need."""
    log = LOGS / "imports.log"
    with unfinished("imports"):
        log.unlink(missing_ok=True)
        packages.install(PYTHON, lists, log, progress)
        packages.compile_bytecode(PYTHON, site_packages(), log, progress)


@contextmanager
def unfinished(what: str):
    """Keep a mark in the environment which tells the next run that this was interrupted.

    Where an installer gave up by itself, as without a network, it is as good as before.
    """
    mark = VENV / f"{UNFINISHED}{what}"
    mark.touch()
    try:
        yield
    except StepFailed:
        mark.unlink()
        raise
    mark.unlink()


def site_packages() -> Path:
    """Return the folder of the environment's modules."""
    return VENV / f"lib/python{sysconfig.get_python_version()}/site-packages"


def colcon(package: str, ros: Path | None, progress: Progress) -> None:
    """Build and install one package with colcon."""
    env = dict(os.environ, PATH=f"{VENV / 'bin'}{os.pathsep}{os.environ.get('PATH', os.defpath)}")
    env |= {"VIRTUAL_ENV": str(VENV), "PYTHONUTF8": "1"}  # whatever letters the path has
    # All cores, also on a busy machine: by itself colcon would have make wait for a lower load.
    env["MAKEFLAGS"] = f"-j{os.cpu_count() or 1}"
    if ros is None:
        env["CMAKE_PREFIX_PATH"] = env["AMENT_PREFIX_PATH"] = str(VENV)
    command = [str(VENV / "bin/colcon"), "--log-base", str(LOGS / "colcon"), "build"]
    # A link only with our pinned setuptools: from 80 on `develop` fails, so it is no default.
    command += ["--symlink-install", "--packages-select", package]
    command += ["--event-handlers", "console_direct+"]
    if package == MESSAGES:
        settings = ["BUILD_TESTING=OFF", "CMAKE_BUILD_TYPE=Release"]
        settings += [f"Python3_EXECUTABLE={PYTHON}", f"ONLY_FOR_PYTHON={'OFF' if ros else 'ON'}"]
        command += ["--cmake-args", *(f"-D{setting}" for setting in settings)]
    log = LOGS / f"{package}.log"
    log.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory() as env[parsed_idl.FOLDER]:
        run_logged("colcon", command, log, progress, env)
    if not (INSTALL / package).is_dir():  # colcon ends well also where it found no such package
        raise StepFailed(f"colcon did not find {package}; see {os.path.relpath(log)}")


def install_nodes(ros: Path | None, progress: Progress) -> None:
    """Install the package itself, its executables so that they start in any folder."""
    colcon(PACKAGE, ros, progress)
    shebangs.repair(INSTALL / PACKAGE / "lib" / PACKAGE, PYTHON)
    packages.compile_bytecode(PYTHON, ROOT / PACKAGE, LOGS / f"{PACKAGE}.log", progress)


def tool_lists(ros: Path | None) -> list[Path]:
    """Return the lists of what builds, in the order in which they are installed."""
    return requirements("installer", "bootstrap", "build", *([] if ros else ["ros"]))


def import_lists() -> list[Path]:
    """Return what nodes and tests import; what drives a browser only where Chromium is."""
    return requirements("runtime", "dev", *(["browser"] if prerequisites.chromium() else []))


def requirements(*names: str) -> list[Path]:
    """Return the lists of pinned packages of these names."""
    return [REQUIREMENTS / f"{name}.txt" for name in names]


def data_files() -> list[str]:
    """Return the names of the files that setup.py installs beside the code."""
    folders = ("params", "launch", "urdf", "rviz", "security")
    found = [file for folder in folders for file in ROOT.glob(f"{folder}/**/*.*")]
    return sorted(str(file.relative_to(ROOT)) for file in found)


def digest(words: list[str], files: list[Path] | None = None) -> str:
    """Return a hash of words, file names and file contents."""
    result = hashlib.sha256("\0".join(words).encode())
    for file in files or []:
        result.update(f"\0{file.relative_to(ROOT)}\0".encode() + file.read_bytes())
    return result.hexdigest()


@contextmanager
def only_one_build():
    """Hold a lock: two builds in one checkout would trip over each other."""
    BUILD.mkdir(exist_ok=True)
    with (BUILD / ".lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            print("make build: waiting for another build in this checkout", flush=True)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


if __name__ == "__main__":
    sys.exit(main())
