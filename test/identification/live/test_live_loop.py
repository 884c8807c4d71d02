# SPDX-License-Identifier: Apache-2.0
"""The hot loop of `characterize` while another thread ends a recording or a torque trial."""

from __future__ import annotations

from types import SimpleNamespace

from screw_module_ros.identification.live.loop import LiveLoop
from screw_module_ros.identification.live.samples import Recording


class Ended:
    """An attribute that another thread sets to None as soon as this one has looked at it."""

    def __init__(self, value):
        self.value = value

    def __get__(self, owner, kind):
        value, self.value = self.value, None
        return value

    def __set__(self, owner, value):
        self.value = value


def loop_with(**ended):
    """Return the loop, without topics, with attributes that end at the first look."""
    kind = type("Loop", (LiveLoop,), {name: Ended(value) for name, value in ended.items()})
    return kind.__new__(kind)


def sample():
    return SimpleNamespace(sequence=1, monotonic_ns=1, position=0.1, velocity=0.0, force=2.0)


def test_a_recording_that_ends_between_two_looks_does_not_end_the_node():
    """The node died, and with it the thread that restores the robot."""
    recording = Recording(5)
    loop = loop_with(_recording=recording)
    samples = [sample()]
    loop._noted(lambda: samples.pop() if samples else None, Recording.note_encoder, 0)
    assert recording.encoder.count == 1

    loop, commands = loop_with(_recording=recording), [sample()]
    loop._source = None
    loop._takes = (None, None, lambda: commands.pop() if commands else None)
    loop._take_commands()
    assert recording.command.count == 1


def test_a_command_after_the_recording_s_end_is_not_an_error():
    recording, sent = Recording(5), []
    loop = loop_with(_recording=recording)
    loop._command = SimpleNamespace()
    loop._outlets = (SimpleNamespace(publish=sent.append), None)
    answered = SimpleNamespace(stamp=None, sequence=1, monotonic_ns=1)
    loop._publish_command(answered, SimpleNamespace(force=3.0), 0)
    assert [command.force for command in sent] == [3.0]
    assert recording.command.count == 1


def test_cancelling_while_the_place_is_left_is_not_an_error():
    halted = []
    loop = loop_with(_source=SimpleNamespace(halt=lambda: halted.append(True)))
    loop.halt()
    assert halted
