# SPDX-License-Identifier: Apache-2.0
"""Installs the pinned packages into the virtual environment: with uv, where uv fails with pip.

uv takes seconds where pip takes a minute, but knows nothing of pip's settings. A machine that has
its index, mirror or folder of wheels from pip's configuration must go on working, so uv is given
those settings, in the environment: an address may hold a password, which belongs in no log.
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
from pathlib import Path

from steps import Progress, StepFailed, run_logged

# pip's setting, uv's variables for it, and what separates several values there
SETTINGS = {
    "index-url": (("UV_DEFAULT_INDEX",), " "),
    "extra-index-url": (("UV_INDEX",), " "),
    "find-links": (("UV_FIND_LINKS",), ","),
    "no-index": (("UV_NO_INDEX",), " "),
    "trusted-host": (("UV_INSECURE_HOST",), " "),
    "timeout": (("UV_HTTP_TIMEOUT",), " "),
    "default-timeout": (("UV_HTTP_TIMEOUT",), " "),
    "cert": (("SSL_CERT_FILE",), " "),
    "client-cert": (("SSL_CLIENT_CERT",), " "),
    "proxy": (("HTTP_PROXY", "HTTPS_PROXY"), " "),
}
SECTIONS = ("global", "install", ":env:")  # of pip's settings; a later one overrides
PIP_OPTIONS = ("--no-deps", "--disable-pip-version-check", "--progress-bar=off", "--no-input")


def get_uv(python: Path, uv_list: Path, log: Path, progress: Progress) -> None:
    """Install uv itself; without it `install` uses pip."""
    try:
        run_logged("pip", [*pip(python), *arguments([uv_list])], log, progress, variables())
    except StepFailed:
        progress.tick("uv cannot be had here")


def install(python: Path, lists: list[Path], log: Path, progress: Progress) -> None:
    """Install all packages of the lists; what source packages are built with must be there."""
    options = ["--no-build-isolation", *arguments(lists)]
    uv = [str(python.with_name("uv")), "pip", "install", "--no-deps", "--python", str(python)]
    env = variables()
    uv_env = {**uv_variables(pip_settings(python)), **env}
    try:
        run_logged("uv", [*uv, *options], log, progress, uv_env)
    except (StepFailed, OSError):
        progress.tick("uv does not work here, going on with pip")
        try:
            run_logged("pip", [*pip(python), "--no-compile", *options], log, progress, env)
        except StepFailed as error:
            way_out = "Is the package index reachable? Then run it again."
            raise StepFailed(f"{error}\n{way_out}") from None


def pip(python: Path) -> list[str]:
    """Return the beginning of a command that installs with pip."""
    return [str(python), "-m", "pip", "install", *PIP_OPTIONS]


def variables() -> dict[str, str]:
    """Return the environment, but no PYTHONPATH: pip takes what lies there for installed."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def arguments(lists: list[Path]) -> list[str]:
    """Return the options that name the lists."""
    return [argument for file in lists for argument in ("-r", str(file))]


def pip_settings(python: Path) -> str:
    """Return what pip is set to on this machine, as `pip config list` prints it."""
    command = [str(python), "-m", "pip", "config", "list"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def uv_variables(listing: str) -> dict[str, str]:
    """Return the environment variables that make uv look where pip would, as pip does."""
    # Without this uv believes the first index that has a package of that name, in any version.
    result = {"UV_INDEX_STRATEGY": "unsafe-best-match"}
    found = re.findall(r"^([^.\n]+)\.([^=\n]+)=(.*)$", listing, flags=re.MULTILINE)
    for section in SECTIONS:
        for where, setting, value in found:
            if where == section and setting in SETTINGS:
                names, separator = SETTINGS[setting]
                text = separator.join(str(ast.literal_eval(value)).split())
                result.update(dict.fromkeys(names, text))
    return result


def compile_bytecode(python: Path, modules: Path, log: Path, progress: Progress) -> None:
    """Compile the modules below a folder on all cores: nodes must start fast from the first time.

    The packages' own tests, a third of all, stay as they are. A file that cannot be compiled, such
    as a template, is no failure.
    """
    tests = re.escape(str(modules)) + "/.*/tests?/"
    command = [str(python), "-I", "-m", "compileall", "-qq", "-j", "0", "-x", tests]
    try:
        run_logged("compileall", [*command, str(modules)], log, progress, dict(os.environ))
    except StepFailed:
        pass
