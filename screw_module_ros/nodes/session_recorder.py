# SPDX-License-Identifier: Apache-2.0
"""`session_recorder`: records topics as a rosbag2 bag (MCAP) and reports what is missing in it.

What was written is on the disk within a second, whatever happens to this process (see
`screw_module_ros.recording`). While the disk is full, messages wait in memory; the recording goes
on when there is room again. A folder that is deleted or cannot be written ends the recording but
not the node; `~/status` and diagnostics show the reason until the next `~/start`.

The name of a bag may be a patient's: `~/status` and the answers of the services tell it, log and
diagnostics do not.
"""

from __future__ import annotations

import os
import shutil
import threading
from pathlib import Path
from typing import Annotated, NamedTuple

from screw_module_msgs.srv import CountSessions, StartRecording
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.loop.ticker import BETWEEN_TICKS_NS, Ticker
from screw_module_ros.recording.bag import Bag, BagError, BagExistsError, StorageSettings
from screw_module_ros.recording.pseudonym import checked_pseudonym, date_in_name, owner
from screw_module_ros.recording.recorder import (
    PARAMETERS,
    REFUSED,
    Recording,
    Status,
    file_hashes,
)
from screw_module_ros.recording.recover import bag_names, unfinished
from screw_module_ros.settings import Setting
from screw_module_ros.software import DIRTY, commit

from .recording_parameters import NodeParameters
from .recording_topics import Taps
from .support.answering import Done
from .support.node import Node
from .support.place import one_name, root_folder
from .support.runtime import main as run_node
from .support.states import ERROR, OK, WARN, Health
from .support.topics import offered

_POLL_S = 0.05
_MOST_IN_A_SECOND = 100
_STAMP_LENGTH = len("session_2001_01_31-12_00_00Z")


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
    topics: Annotated[
        tuple, Setting("names of topics to record beside those of the robot", live=True)
    ] = ("",)
    configuration: Annotated[
        tuple, Setting("files whose hashes are noted in the bag, like parameter files", live=True)
    ] = ("",)
    allow_dirty: Annotated[
        bool, Setting("record patients also with software that differs from its commit", live=True)
    ] = False
    period: Annotated[
        float, Setting("period in which the queues of all topics are emptied", "s", 0.001, 0.1)
    ] = 0.02


class SessionRecorder(Node):
    """Takes messages in the hot loop; the recording's own thread writes them."""

    def __init__(self) -> None:
        super().__init__("session_recorder")
        self.parameters.declare(RecorderSettings, storage=StorageSettings)
        self._taps: Taps | None = None  # of the recording that runs
        self._last: Status | None = None
        self._folder: Path | None = None
        self._refusal = ""
        self._is_held = False
        self._lock = threading.Lock()  # the loop takes messages, or services change the recording
        self.serve(Trigger, "~/start", lambda _: self._on_start(self._named()))
        self.serve(StartRecording, "~/record", lambda request: self._on_start(request.name))
        self.serve(Trigger, "~/stop", self._on_stop, always=True)
        self.serve(CountSessions, "~/count", self._count)
        self._status = self.create_publisher(*offered(graph.RECORDER_STATUS))
        self.periodic.every(self.clock, 1.0, self._each_second)

    def connect(self) -> None:
        """Report bags whose recorder was killed."""
        self._period = self.parameters.read(RecorderSettings).period
        try:
            parent = self._parent()
        except ValueError as error:  # told again by each start
            self.get_logger().warning(str(error))
            return
        if found := unfinished(parent):
            self.get_logger().warning(
                f"{len(found)} bags below {parent} are unfinished, as they have no metadata.yaml: "
                "`session recover` makes a readable copy of each"
            )

    def _parent(self) -> Path:
        """Return the folder of the bags. Raises ValueError for the home folder of no user."""
        return root_folder(self.parameters.read(RecorderSettings).folder)

    def begin(self) -> None:
        """Start recording if `record_on_start` is set."""
        self._refusal = ""
        if self.parameters.read(RecorderSettings).record_on_start:
            self._refusal = self._start(self._named())

    def step(self) -> None:
        """Empty the queues."""
        if self._taps is None:
            self.clock.rest(self.stopping, _POLL_S)  # it holds no simulated time meanwhile
            return
        self._ticker.sleep()
        with self._lock:
            if self._taps is not None:
                self._taps.recording.put(self._taps.drain())

    def end(self) -> None:
        """Close the bag."""
        self._stop()

    def _named(self) -> str:
        """Return the parameter `name`."""
        return self.parameters.read(RecorderSettings).name

    def _start(self, name: str) -> str:
        """Start a bag of this name; return why it failed, empty when it records."""
        try:
            taps = self._begun(self._new_recording(name))
        except (BagError, ValueError) as error:
            text = str(error)
        except OSError as error:  # files, threads or memory have run out
            text = f"cannot record: {error.strerror}"
        else:
            with self._lock:
                self._ticker = Ticker(self.clock, round(self._period * 1e9), BETWEEN_TICKS_NS)
                self._asked = NodeParameters(self)
                self._folder, self._taps, self._is_held = taps.recording.folder, taps, False
            self._asked.ask()
            self.get_logger().info("recording")
            return ""
        self.get_logger().error(text)
        return text

    def _new_recording(self, name: str) -> Recording:
        """Return a recording in its own folder, without a name in one by date and time.

        Another recorder may start in the same second. Raises BagError, ValueError.
        """
        storage = self.parameters.read(StorageSettings, "storage")
        parent = self._parent()
        if name:
            return self._recording(parent / one_name(name, "name"), storage)
        name = f"session_{date_in_name()}"
        for number in range(2, _MOST_IN_A_SECOND):
            try:
                return self._recording(parent / name, storage)
            except BagExistsError:
                name = f"{name[:_STAMP_LENGTH]}_{number}"
        return self._recording(parent / name, storage)

    def _recording(self, folder: Path, storage: StorageSettings) -> Recording:
        return Recording(Bag(folder, storage), storage, clock=self.clock)

    def _begun(self, recording: Recording) -> Taps:
        """Start the recording's thread and subscribe; on an error close the bag and raise it."""
        settings = self.parameters.read(RecorderSettings)
        try:
            recording.note("configuration", file_hashes(settings.configuration))
            recording.start()
            return Taps(self, self.clock, recording, [name for name in settings.topics if name])
        except BaseException:
            recording.close()
            shutil.rmtree(recording.folder, ignore_errors=True)  # nothing was recorded
            raise

    def _stop(self) -> Status | None:
        """Close the bag; return what it holds, None without one."""
        with self._lock:
            taps, self._taps = self._taps, None
            if taps is None:
                return None
            taps.recording.put(taps.drain())
            self._note(taps)  # what was told in the last second
            taps.close()
            self._asked.close()
        self._last = taps.recording.close()
        self.get_logger().info(self._last.summary())
        return self._last

    def _note(self, taps: Taps) -> None:
        """Write the parameters of the nodes into the bag, and what is not recorded."""
        taps.recording.note(PARAMETERS, dict(self._asked.values))
        if taps.refused:
            taps.recording.note(REFUSED, dict(taps.refused))

    def _on_start(self, name: str) -> str:
        allowed = self.parameters.read(RecorderSettings).allow_dirty
        if owner(name) and commit().endswith(DIRTY) and not allowed:
            return (
                f"no patient is recorded with software that differs from its commit ({commit()}): "
                "commit or undo the changes and start the robot again, or set allow_dirty"
            )
        if self._taps is not None and self._taps.recording.status().records:
            return "already recording: stop that first"  # the one who asks may log it
        self._stop()
        self._refusal = self._start(name)
        return self._refusal or Done(str(self._folder))

    def _on_stop(self, request: Trigger.Request) -> str:
        status = self._stop()
        if status is None:
            return "not recording"
        text = status.summary()
        return text if status.error else Done(f"{self._folder}: {text}")

    def _count(self, request: CountSessions.Request) -> str:
        """Count the bags that `therapy_session` has named after a patient."""
        sessions = len(bag_names(self._parent(), f"{checked_pseudonym(request.patient)}_"))
        return Done(f"{sessions} recorded", sessions=sessions)

    def _each_second(self) -> None:
        taps = self._taps
        if taps is not None and not (status := taps.recording.status()).error:
            self._tell_held(status)
            try:
                taps.look()
                self._asked.ask()
                self._note(taps)
            except Exception as error:  # the graph may change while it is asked; ask again
                self.get_logger().warning(f"looking for topics: {type(error).__name__}: {error}")
        health = self.health()
        health.values["bag"] = self._folder or ""
        name = self.get_fully_qualified_name()
        self._status.publish(health.status(name, self.hardware_id))

    def _tell_held(self, status: Status) -> None:
        """Log when nothing reaches the disk, and when it does again, with what was lost."""
        if bool(status.held) != self._is_held:
            self._is_held = bool(status.held)
            if self._is_held:
                self.get_logger().error(f"{status.held}; messages wait in memory")
            else:
                lost = f"{status.dropped} messages were not written"
                self.get_logger().warning(f"the disk has room, the recording goes on: {lost}")

    def _start_refusal(self) -> str:
        """Return why `~/start` would fail to create a bag, empty if no reason is known."""
        try:
            if name := self._named():
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
        taps = self._taps
        status = self._last if taps is None else taps.recording.status()
        values: dict[str, object] = {"recording": bool(taps and status and status.records)}
        refusal = self._refusal or ("" if taps else self._start_refusal())
        if status is None:
            return Health(ERROR if refusal else OK, refusal or "not recording", values)
        values |= {
            "messages": status.messages,
            "waiting": status.waiting,
            "dropped": status.dropped,
            "size [B]": status.size,
        }
        values |= {name: counts.as_text() for name, counts in status.audit.items()}
        refused = taps.refused if taps is not None else {}
        values |= {f"not recorded: {name}": why for name, why in refused.items()}
        if why := refusal or status.error or status.held:
            return Health(ERROR, why, values)
        level = WARN if status.dropped or refused else OK
        return Health(level, status.summary(), values)


def main() -> int:
    """Console entry point."""
    os.umask(0o077)  # only the owner may read a patient's recording
    return run_node(SessionRecorder)
