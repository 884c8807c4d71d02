# SPDX-License-Identifier: Apache-2.0
"""A recorder killed with SIGKILL leaves a bag that all readers open, up to its last flush.

The kernel may end a write in its midst for SIGKILL: then `session recover` is needed, which the
fuzzer of bags tries at random places. Here the writer is stopped first, which lets a write end.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from screw_module_ros.recording.verify import verify

WRITER = """
import sys
from screw_module_ros.recording import BagWriter, Definition, StorageSettings, Topic
TEXT = (
    "builtin_interfaces/Time stamp\\nuint32 sequence\\n" + "\\n" + "=" * 80
    + "\\nMSG: builtin_interfaces/Time\\nint32 sec\\nuint32 nanosec\\n"
)
writer = BagWriter(sys.argv[1], StorageSettings(chunk_size=4096))
topic = Topic("/x", "own_msgs/msg/X", Definition("ros2msg", TEXT, ""))
channel = writer.add_topic(topic)
writer.add_metadata("configuration", {"a": "b"})
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


def test_mcap_opens_it_as_it_is(killed):
    bag, flushed = killed
    with (bag / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_summary().statistics.message_count >= flushed
        assert sum(1 for _ in reader.iter_messages()) >= flushed


def test_rosbags_opens_it_as_it_is(killed):
    bag, flushed = killed
    with AnyReader([bag]) as reader:
        data = [data for _, _, data in reader.messages()]
    assert len(data) >= flushed
    assert [int.from_bytes(d[12:16], "little") for d in data] == list(range(len(data)))


def test_verify_says_that_it_was_not_closed_and_nothing_else(killed):
    bag, flushed = killed
    report = verify(bag)
    assert report.topics["/x"].messages >= flushed
    assert report.topics["/x"].lost == 0
    assert "not closed" in report.problems[0]
    assert report.notes["configuration"] == {"a": "b"}
