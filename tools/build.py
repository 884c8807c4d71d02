# SPDX-License-Identifier: Apache-2.0
"""`make build`: from a fresh clone to installed packages; what is done already is skipped.

Virtual environment, pinned packages, screw_module_msgs, screw_module_ros: each step leaves a stamp,
a hash of what went in, and is done again when that changed. With ROS 2 Jazzy sourced the step that
installs the ROS wheels falls away. Standard library only.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from contextlib import contextmanager
from pathlib import Path

import prerequisites
import ros_wheels
from steps import Progress, StepFailed, run_logged

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin/python"
BUILD, INSTALL = ROOT / "build", ROOT / "install"
LOGS = BUILD / "log"
REQUIREMENTS = ROOT / "requirements"
MESSAGES, PACKAGE = "screw_module_msgs", "screw_module_ros"
HOOK = "_screw_module_ros_env"  # must sort before ros_wheels_bootstrapper
STEPS = 4


def main() -> int:
    """Run the steps that are needed; return the exit code."""
    started = time.monotonic()
    os.chdir(ROOT)  # where colcon looks for its defaults, and what the logs' names are relative to
    try:
        prerequisites.check_python()
        ros = prerequisites.ros_prefix()
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
    environment = digest([str(ROOT), sys.version, str(ros)])
    files = requirement_files(ros)
    packages = digest([environment], files + [ROOT / "tools/venv_hook.py"])
    builders = [file for file in files if file.stem in ("build", "ros")]
    definitions = sorted(file for file in (ROOT / "msg_defs").rglob("*") if file.is_file())
    messages = digest([environment], builders + definitions)
    described = [ROOT / name for name in ("setup.py", "setup.cfg", "package.xml")]
    installed = digest([environment, *data_files()], builders + described)
    steps = (
        ("virtual environment", VENV, environment, lambda: make_venv(ros)),
        ("pinned packages", VENV / "bin", packages, lambda: install(files, ros, progress)),
        (MESSAGES, INSTALL / MESSAGES, messages, lambda: colcon(MESSAGES, ros, progress)),
        (PACKAGE, INSTALL / PACKAGE, installed, lambda: colcon(PACKAGE, ros, progress)),
    )
    if all(fits(folder, stamp) for _, folder, stamp, _ in steps):
        return False
    prerequisites.check_disk(ROOT)
    for what, folder, stamp, work in steps:
        progress.begin(what)
        if fits(folder, stamp):
            progress.done("is up to date")
            continue
        work()
        (folder / ".stamp").write_text(stamp)
        progress.done()
    return True


def make_venv(ros: Path | None) -> None:
    """Make the virtual environment anew; what was built with an older one goes with it."""
    for folder in (VENV, BUILD / MESSAGES, BUILD / PACKAGE, INSTALL):
        shutil.rmtree(folder, ignore_errors=True)
    options = ["--system-site-packages"] if ros else []
    command = [prerequisites.interpreter(), "-m", "venv", *options, str(VENV)]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode != 0:
        raise StepFailed(f"python -m venv failed: {(made.stderr or made.stdout).strip()}")


def install(files: list[Path], ros: Path | None, progress: Progress) -> None:
    """Install the pinned packages, then the hook that makes Python find what is built."""
    pip = [str(PYTHON), "-m", "pip", "install", "--no-deps", "--disable-pip-version-check"]
    pip += ["--progress-bar", "off", "--no-input"]
    bootstrap, rest = files[0], files[1:]
    # pip would take what lies on PYTHONPATH, a sourced ROS, for part of the environment.
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    log = LOGS / "pip.log"
    log.unlink(missing_ok=True)
    try:
        run_logged("pip", [*pip, "-r", str(bootstrap)], log, progress, env)
        listed = [argument for file in rest for argument in ("-r", str(file))]
        run_logged("pip", [*pip, "--no-build-isolation", *listed], log, progress, env)
    except StepFailed as error:
        raise StepFailed(f"{error}\nIs the package index reachable? Then run it again.") from None
    if ros is None:
        ros_wheels.rewrite_cmake_files(VENV)
    site_packages = VENV / f"lib/python{sysconfig.get_python_version()}/site-packages"
    shutil.copy(ROOT / "tools/venv_hook.py", site_packages / f"{HOOK}.py")
    (site_packages / f"{HOOK}.pth").write_text(f"import {HOOK}\n")


def colcon(package: str, ros: Path | None, progress: Progress) -> None:
    """Build and install one package with colcon."""
    env = dict(os.environ, PATH=f"{VENV / 'bin'}{os.pathsep}{os.environ.get('PATH', os.defpath)}")
    env["VIRTUAL_ENV"] = str(VENV)
    if ros is None:
        env["CMAKE_PREFIX_PATH"] = env["AMENT_PREFIX_PATH"] = str(VENV)
    command = [str(VENV / "bin/colcon"), "--log-base", str(LOGS / "colcon"), "build"]
    command += ["--packages-select", package, "--event-handlers", "console_direct+"]
    if package == MESSAGES:
        options = ("BUILD_TYPE=Release", f"Python3_EXECUTABLE={PYTHON}")
        command += ["--cmake-args", "-DBUILD_TESTING=OFF", f"-DCMAKE_{options[0]}"]
        command += [f"-D{options[1]}"]
    log = LOGS / f"{package}.log"
    log.unlink(missing_ok=True)
    run_logged("colcon", command, log, progress, env)


def requirement_files(ros: Path | None) -> list[Path]:
    """Return the lists of pinned packages, the one that pip itself builds with first."""
    names = ["bootstrap", "runtime", "dev", "build"] + ([] if ros else ["ros"])
    return [REQUIREMENTS / f"{name}.txt" for name in names]


def data_files() -> list[str]:
    """Return the names of the files that setup.py installs beside the code."""
    found = [*ROOT.glob("params/*.yaml"), *ROOT.glob("launch/*.py")]
    return sorted(str(file.relative_to(ROOT)) for file in found)


def digest(words: list[str], files: list[Path] | None = None) -> str:
    """Return a hash of words, file names and file contents."""
    result = hashlib.sha256("\0".join(words).encode())
    for file in files or []:
        result.update(f"\0{file.relative_to(ROOT)}\0".encode() + file.read_bytes())
    return result.hexdigest()


def fits(folder: Path, stamp: str) -> bool:
    """Return whether the folder was made from what the stamp stands for."""
    try:
        return (folder / ".stamp").read_text() == stamp
    except OSError:
        return False


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
