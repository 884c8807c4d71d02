# SPDX-License-Identifier: Apache-2.0
"""A recorder killed with SIGKILL leaves a bag of which all that was flushed can be recovered."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from bag_counts import sequences

from screw_module_ros.recording.recover import recover, unfinished
from screw_module_ros.recording.verify import verify

WRITER = """
import sys
from screw_module_ros.recording.bag import Bag, StorageSettings, Topic
from screw_module_ros.recording.definitions import Definition
TEXT = (
    "builtin_interfaces/Time stamp\\nuint32 sequence\\n" + "\\n" + "=" * 80
    + "\\nMSG: builtin_interfaces/Time\\nint32 sec\\nuint32 nanosec\\n"
)
writer = Bag(sys.argv[1], StorageSettings(chunk_size=4096))
topic = Topic("/x", "own_msgs/msg/X", Definition("ros2msg", TEXT, ""))
channel = writer.add_topic(topic)
writer.note("configuration", {"a": "b"})
number = 0
while True:
    batch = []
    for _ in range(100):
        data = b"\\0\\1\\0\\0" + bytes(8) + number.to_bytes(4, "little")
        batch.append((channel, 10**18 + number * 10**6, 10**18, number + 1, data))
        number += 1
    writer.write(batch)
    writer.flush()
    print(number, flush=True)
"""


@pytest.fixture(params=[1, 7, 60])
def killed(tmp_path, wait_until, request):
    """Return the bag and the number of messages its writer had flushed when it was killed."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path / "bag")],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    flushed = 0
    for _ in range(request.param):
        flushed = int(process.stdout.readline())
    process.send_signal(signal.SIGSTOP)
    state = Path(f"/proc/{process.pid}/stat")
    wait_until(lambda: state.read_text().rpartition(")")[2].split()[0] == "T")
    process.send_signal(signal.SIGKILL)
    process.wait()
    rest = process.stdout.read().split()
    process.stdout.close()
    return tmp_path / "bag", int(rest[-1]) if rest else flushed


def test_what_was_flushed_is_recovered(killed):
    bag, flushed = killed
    assert any("(state: unfinished)" in problem for problem in verify(bag).problems)
    assert unfinished(bag.parent) == [bag]
    found = recover(bag)
    assert found.folder == bag.with_name("bag_recovered")
    assert found.messages >= flushed
    assert sequences(found.folder) == list(range(found.messages))
    assert unfinished(bag.parent) == []
    report = verify(found.folder)
    assert report.problems == ["the bag is a recovered copy: what was lost before is not known"]
    assert report.notes["configuration"] == {"a": "b"}
