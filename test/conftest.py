# SPDX-License-Identifier: Apache-2.0
"""Fixtures for all tests: a ROS domain of their own, waiting, and no leaked bus.

`make test` gives the run its domain; pytest started by hand takes one here, and so does each of
several workers.
"""

from __future__ import annotations

import functools
import gc
import importlib
import json
import os
import pickle
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import can
import can.interfaces.virtual
import canopen
import pytest
from hypothesis import settings

import isolation
import leftovers
import prerequisites
from screw_module_ros import settings_file

SECONDS_BETWEEN_POLLS = 0.005
EXAMPLES = Path(__file__).parents[1] / "examples"

# How long an example takes is no property of the code. `make fuzz` looks deeper.
settings.register_profile("suite", deadline=None, max_examples=40)
settings.load_profile("suite")

GRAPH_ENDS_S = 900
"""Wall clock after which a test with a whole graph hangs: simulated time waits for the machine."""

_buses: weakref.WeakSet[can.BusABC] = weakref.WeakSet()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--write", action="store_true", help="rewrite generated files, like faults.md")
    parser.addoption(
        "--arrangement", choices=("apart", "composed"),
        help="fault rows: carry out each so, where it can be",
    )  # fmt: skip


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect without the garbage collector, and let it pass over what is collected.

    That is all imported modules and thousands of tests: 0.4 s each time, and a test that destroys
    a node has the garbage collected at once.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give each test with a whole graph the same time; it is only there to end one that hangs.

    The files of such tests come first: a worker that took one last would work on alone for a
    minute.
    """
    with_graph = {item.path for item in items if item.get_closest_marker("graph")}
    items.sort(key=lambda item: item.path not in with_graph)
    for item in items:
        if item.get_closest_marker("graph"):
            item.add_marker(pytest.mark.timeout(GRAPH_ENDS_S))


@pytest.fixture
def importing(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., ModuleType]]:
    """Return `importing(folder, module)`: a module of an example, as its README runs it.

    Afterwards the folder's modules are forgotten: another example has a `try_it` too.
    """
    folders = []

    def imported(folder: str, module: str) -> ModuleType:
        folders.append(EXAMPLES / folder)
        monkeypatch.syspath_prepend(str(folders[-1]))
        return importlib.import_module(module)

    yield imported
    for name, module in list(sys.modules.items()):
        if Path(getattr(module, "__file__", None) or "/").parent in folders:
            del sys.modules[name]


@pytest.fixture(scope="session", autouse=True)
def ros_domain_id(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Give this run its own ROS domain, in the environment of this process and its children."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_LOG_DIR", str(tmp_path_factory.mktemp("ros_log")))
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        if leftovers.MARK in os.environ and "PYTEST_XDIST_WORKER" not in os.environ:
            yield int(os.environ[isolation.DOMAIN_VARIABLE])
            return
        with isolation.own_domain() as domain:
            for name, value in isolation.variables(domain).items():
                patch.setenv(name, value)
            yield domain


@pytest.fixture(scope="module", autouse=True)
def no_node_of_earlier_tests(request: pytest.FixtureRequest) -> None:
    """Remove the nodes that earlier tests of this process have destroyed.

    Others see a destroyed node under its name until it is garbage-collected.
    """
    if request.node.get_closest_marker("graph"):
        gc.collect()


@pytest.fixture
def wait_until() -> Callable[..., None]:
    """Return `wait_until(predicate, deadline_s=10.0, what="")`: polls, fails at the deadline.

    The predicate may do work, such as pumping a bus. The deadline is only there to end a test
    that will fail; no test should be about how long something took.
    """
    pause = threading.Event()

    def wait(predicate: Callable[[], object], deadline_s: float = 10.0, what: str = "") -> None:
        deadline = time.monotonic() + deadline_s
        while not predicate():
            if time.monotonic() > deadline:
                pytest.fail(f"{what or 'what was waited for'} did not happen in {deadline_s} s")
            pause.wait(SECONDS_BETWEEN_POLLS)

    return wait


@pytest.fixture
def kept(request: pytest.FixtureRequest) -> Callable[..., None]:
    """Return `kept(found)`: fails unless it is what the JSON file beside the test holds for it.

    rel: share by which the numbers of a flat dictionary may differ; by default they must be equal.
    With --write it becomes that, after a look at the difference; the commit says what changed.
    """
    file, name = request.path.with_suffix(".json"), request.node.name

    def compare(found: object, rel: float | None = None) -> None:
        stored = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        if request.config.getoption("--write"):
            text = json.dumps(stored | {name: found}, indent=1, sort_keys=True)
            file.write_text(text + "\n", encoding="utf-8")
        else:
            wanted = stored[name]
            assert found == (wanted if rel is None else pytest.approx(wanted, rel=rel, nan_ok=True))

    return compare


@pytest.fixture
def bench():
    """A robot in one thread that is connected, homed, tared and not enabled."""
    from screw_module_ros.trials.one_thread import OneThreadRobot  # most tests need no robot

    made = OneThreadRobot()
    made.ready()
    yield made
    made.close()


@pytest.fixture
def kill_9() -> Callable[[int], None]:
    """Return `kill_9(pid)`: kills a process and removes the shared memory it had to itself."""
    return leftovers.kill


@pytest.fixture(scope="session", autouse=True)
def _files_parsed_once() -> Iterator[None]:
    """Parse each EDS file and each YAML text once; who reads it again gets a copy.

    Every simulated robot reads thirteen of them, which takes half as long as making it ready.
    """
    import_od, parse = canopen.import_od, settings_file.parse

    @functools.cache
    def objects(file: object, node_id: int) -> bytes:
        return pickle.dumps(import_od(file, node_id))

    @functools.lru_cache(maxsize=200)
    def content(text: str, where: str, for_ros: bool = False) -> bytes:
        return pickle.dumps(parse(text, where, for_ros))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(canopen, "import_od", lambda *a: pickle.loads(objects(*a)))
        patch.setattr(settings_file, "parse", lambda *a, **k: pickle.loads(content(*a, **k)))
        yield


@pytest.fixture(scope="session", autouse=True)
def _note_buses() -> Iterator[None]:
    """Note each bus that is opened, for `no_leaked_bus`."""
    original = can.BusABC.__init__

    def init(self: can.BusABC, *args: object, **kwargs: object) -> None:
        original(self, *args, **kwargs)
        _buses.add(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(can.BusABC, "__init__", init)
        yield


@pytest.fixture(autouse=True)
def no_leaked_bus(_note_buses: None) -> Iterator[None]:
    """Fail a test that leaves a CAN bus open, or a channel of the virtual bus behind."""
    buses, channels = set(_buses), set(can.interfaces.virtual.channels)
    yield
    left = [bus for bus in set(_buses) - buses if not bus._is_shutdown]
    names = [str(bus) for bus in left]
    for bus in left:
        bus.shutdown()
    names += [f"virtual channel {n}" for n in set(can.interfaces.virtual.channels) - channels]
    if names:
        pytest.fail("left open by this test: " + ", ".join(names))


@pytest.fixture(scope="module")
def browser():
    """Chromium, driven by Playwright; skips where one of them is missing."""
    sync_api = pytest.importorskip(
        "playwright.sync_api", reason="Playwright is not installed: see CONTRIBUTING.md"
    )
    path = prerequisites.chromium()
    if path is None:
        pytest.skip("Chromium is not installed: see CONTRIBUTING.md")
    arguments = ["--no-sandbox"] if os.getuid() == 0 else []
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=arguments)
        yield browser
        browser.close()
