# SPDX-License-Identifier: Apache-2.0
"""`session_recorder`: records topics as a rosbag2 bag (MCAP) and reports what is missing in it.

The bag on the disk is complete every second, whatever happens to this process (see
`screw_module_ros.recording`). A full disk or an unwritable folder ends the recording but not the
node; `~/status` and diagnostics show the reason until the next `~/start`.
"""

from __future__ import annotations

import os
import threading
from datetime import datetime
from pathlib import Path
from typing import Annotated, NamedTuple

from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.loop.ticker import BETWEEN_TICKS_NS, Ticker
from screw_module_ros.recording import (
    BagError,
    BagExistsError,
    BagWriter,
    Session,
    Status,
    StorageSettings,
)
from screw_module_ros.recording.bag import REFUSED
from screw_module_ros.recording.recovery import recover_all
from screw_module_ros.recording.seal import CALIBRATION, PARAMETERS
from screw_module_ros.recording.session import file_hashes
from screw_module_ros.settings import Setting

from .session_intake import Intake, Selection
from .session_parameters import NodeParameters
from .session_robots import OtherRobots
from .support.answering import Done
from .support.node import Node
from .support.place import one_name, root_folder
from .support.runtime import main as run_node
from .support.states import ERROR, OK, WARN, Health
from .support.topics import offered

_IDLE_S = 0.05
_MOST_IN_A_SECOND = 100
_STAMP_LENGTH = len("session_2001_01_31-12_00_00")


class RecorderSettings(NamedTuple):
    """Topics to record, and the folder; changes apply from the next recording on."""

    folder: Annotated[
        str, Setting("folder of all bags, no bag lies outside of it; ~ is the home folder",
                     at_start=True)
    ] = "~/sessions"
    name: Annotated[
        str, Setting("name of the bag, empty = from date and time", live=True)
    ] = ""
    record_on_start: Annotated[bool, Setting("start recording when the node is activated")] = False
    topics: Annotated[tuple, Setting("topics to record, or patterns like /screw/*", live=True)] = (
        "*",
    )
    other_robots: Annotated[
        bool, Setting("record the topics of robots in other namespaces too", live=True)
    ] = False
    exclude: Annotated[tuple, Setting("topics to leave out, names or patterns", live=True)] = (
        "*/decimated",
    )
    include_hidden: Annotated[
        bool, Setting("also record topics with a name part that begins with _", live=True)
    ] = False
    configuration: Annotated[
        tuple, Setting("files whose hashes are noted in the bag, like parameter files", live=True)
    ] = ("",)
    period: Annotated[
        float, Setting("period in which the queues of all topics are emptied", "s", 0.001, 0.1)
    ] = 0.02


class SessionRecorder(Node):
    """Takes messages in the hot loop; the session's own thread writes them."""

    def __init__(self):
        super().__init__("session_recorder")
        self.parameters.declare(RecorderSettings)
        self.parameters.declare(StorageSettings, "storage")
        self._session: Session | None = None
        self._intake: Intake | None = None
        self._noted_parameters: NodeParameters | None = None
        self._others: OtherRobots | None = None
        self._last: Status | None = None
        self._folder: Path | None = None
        self._refusal = ""
        self._lock = threading.Lock()  # the loop takes messages, or services change the session
        self.serve(Trigger, "~/start", self._on_start)
        self.serve(Trigger, "~/stop", self._on_stop, always=True)
        self._status = self.create_publisher(*offered(graph.RECORDER_STATUS))
        self.periodic.every(self.clock, 1.0, self._each_second)

    def connect(self) -> None:
        """Repair bags that a power failure cut off."""
        self._period = self.parameters.read(RecorderSettings).period
        try:
            found = recover_all(self._parent())
        except ValueError as error:  # told again by each start
            self.get_logger().warning(str(error))
            return
        for folder, result in found.items():
            why = "left as it is" if isinstance(result, BagError) else "had been cut off"
            self.get_logger().warning(f"{folder}: {why}: {result}")

    def _parent(self) -> Path:
        """Return the folder of the bags. Raises ValueError for the home folder of no user."""
        return root_folder(self.parameters.read(RecorderSettings).folder)

    def begin(self) -> None:
        """Start recording if `record_on_start` is set."""
        self._refusal = ""
        if self.parameters.read(RecorderSettings).record_on_start:
            self._refusal = self._start()

    def step(self) -> None:
        """Empty the queues."""
        if self._session is None:
            self.clock.idle()  # without a recording this thread does not hold simulated time
            self.stopping.wait(_IDLE_S)
            return
        self._ticker.sleep()
        with self._lock:
            if self._session is not None and self._intake is not None:
                self._session.put(self._intake.drain())

    def end(self) -> None:
        """Close the bag."""
        self._stop()

    def _start(self) -> str:
        """Start a bag; return why it failed, empty when it records."""
        settings = self.parameters.read(RecorderSettings)
        try:
            session, intake = self._opened(settings)
        except (BagError, ValueError) as error:
            text = str(error)
        except OSError as error:  # files, threads or memory have run out
            text = f"cannot record: {error.strerror}"
        else:
            return self._begin(session, intake)
        self.get_logger().error(text)
        return text

    def _opened(self, settings: RecorderSettings) -> tuple[Session, Intake]:
        """Return a session with its bag on the disk, and its intake; on an error leave neither.

        Raises BagError, ValueError, OSError.
        """
        session = self._new_session(settings)
        try:
            session.add_metadata("configuration", file_hashes(settings.configuration))
            session.start()
            topics = tuple(
                t if t[:1] in "/*" else self.resolve_topic_name(t) for t in settings.topics
            )
            self._others = None if settings.other_robots else OtherRobots(self)
            selection = Selection(topics, settings.exclude, settings.include_hidden, self._others)
            intake = Intake(self, self.clock, selection, session)
            intake.discover()
        except BaseException:
            session.close()
            raise
        return session, intake

    def _new_session(self, settings: RecorderSettings) -> Session:
        """Return a session in its own folder; another recorder may start in the same second."""
        storage = self.parameters.read(StorageSettings, "storage")
        parent = self._parent()
        if settings.name:
            name = one_name(settings.name, "name")
            return Session(BagWriter(parent / name, storage), storage)
        name = datetime.now().strftime("session_%Y_%m_%d-%H_%M_%S")
        for number in range(2, _MOST_IN_A_SECOND):
            try:
                return Session(BagWriter(parent / name, storage), storage)
            except BagExistsError:
                name = f"{name[:_STAMP_LENGTH]}_{number}"
        return Session(BagWriter(parent / name, storage), storage)

    def _begin(self, session: Session, intake: Intake) -> str:
        folder = session.folder
        with self._lock:
            self._ticker = Ticker(self.clock, round(self._period * 1e9), BETWEEN_TICKS_NS)
            self._folder, self._intake, self._session = folder, intake, session
            self._noted_parameters = NodeParameters(self, self._is_other)
        self._noted_parameters.ask()
        self.get_logger().info(f"recording to {folder}")
        return ""

    def _is_other(self, node: str) -> bool:
        """Return whether the node of this full name belongs to a robot that is not recorded."""
        return self._others is not None and self._others.have(node)

    def _stop(self) -> None:
        with self._lock:
            session, intake = self._session, self._intake
            self._session = self._intake = None
            if session is None or intake is None:
                return
            session.put(intake.drain())
            self._note(session, intake)  # what was told in the last second
            intake.close()
            self._noted_parameters.close()
        self._last = session.close()
        self.get_logger().info(self._last.summary())

    def _note(self, session: Session, intake: Intake) -> None:
        """Write parameters and calibrations of the nodes into the bag."""
        session.add_metadata(CALIBRATION, intake.calibrations())
        session.add_metadata(PARAMETERS, self._noted_parameters.values)
        if intake.refused:
            session.add_metadata(REFUSED, intake.refused)

    def _on_start(self, request: Trigger.Request) -> str:
        if self._session is not None and not self._session.status().error:
            return f"already recording to {self._folder}: stop that first"
        self._stop()
        self._refusal = self._start()
        return self._refusal or Done(str(self._folder))

    def _on_stop(self, request: Trigger.Request) -> str:
        if self._session is None:
            return "not recording"
        self._stop()
        text = f"{self._folder}: {self._last.summary()}"
        return text if self._last.error else Done(text)

    def _each_second(self) -> None:
        session, intake = self._session, self._intake
        if session is not None and intake is not None and not session.status().error:
            try:
                intake.discover()
                self._noted_parameters.ask()
                self._note(session, intake)
            except Exception as error:  # the graph may change while it is asked; ask again
                self.get_logger().warning(f"looking for topics: {type(error).__name__}: {error}")
        name = self.get_fully_qualified_name()
        self._status.publish(self.health().status(name, self.hardware_id))

    def _hindrance(self) -> str:
        """Return why `~/start` would fail to create a bag, empty if no reason is known."""
        try:
            if name := self.parameters.read(RecorderSettings).name:
                one_name(name, "name")
            folder = self._parent()
        except ValueError as error:
            return str(error)
        # `Path.exists` raises below a folder that this user may not enter.
        there = next(path for path in (folder, *folder.parents) if os.path.exists(path))
        if not there.is_dir():
            return f"cannot record to {folder}: {there} is no folder"
        if not os.access(there, os.W_OK | os.X_OK):
            return f"cannot record to {folder}: no permission to write into {there}"
        return ""

    def health(self) -> Health:
        """Report whether a recording runs and what is missing in it."""
        session, intake = self._session, self._intake
        status = session.status() if session is not None else self._last
        values = {"recording": session is not None and not status.error, "bag": self._folder or ""}
        refusal = self._refusal
        if session is None:
            refusal = refusal or self._hindrance()
        if status is None:
            return Health(ERROR if refusal else OK, refusal or "not recording", values)
        values |= {
            "messages": status.messages,
            "waiting": status.waiting,
            "dropped": status.dropped,
            "size [B]": status.size,
        }
        values |= {name: counts.as_text() for name, counts in status.audit.items()}
        refused = intake.refused if intake is not None else {}
        values |= {f"not recorded: {name}": why for name, why in refused.items()}
        if refusal or status.error:
            return Health(ERROR, refusal or status.error, values)
        level = WARN if status.dropped or refused else OK
        return Health(level, status.summary(), values)


def main() -> int:
    """Console entry point."""
    os.umask(0o077)  # only the owner may read a patient's recording
    return run_node(SessionRecorder)
