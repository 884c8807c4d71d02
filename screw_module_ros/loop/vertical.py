# SPDX-License-Identifier: Apache-2.0
"""The vertical loop, from the encoder to the torque: one period of the roles in this process.

::

    tick -> SYNC and poll -> readings -> controller -> torque to the drive -> publish

The separate nodes, the node `module` and the tests run this one loop. If a role runs in another
process, a wire (`Wires`: a topic) replaces the call.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from ..clock import Clock
from ..samples import Command, EncoderReading, ForceReading
from .sensor import PolledSensor
from .ticker import BACK_OFF_S, Ticker

if TYPE_CHECKING:  # a loop of a sensor alone imports neither law nor drive
    from ..control.vertical import VerticalOutput
    from .controller import VerticalController
    from .drive import VerticalDrive

_LOOK_NS = 10_000  # time to read only frames that are already in the socket
_LISTENS = 2  # periods
_FORCE_WAIT = 0.1  # share of a period: the wait for the force sample of the same tick
_TRY_AGAIN = 64  # periods between such waits while the sample is always late


class Roles(NamedTuple):
    """The roles of the loop; None: in another process, or not active.

    controller: a `VerticalController`, drive: a `VerticalDrive`.
    """

    encoder: PolledSensor[EncoderReading] | None = None
    force_sensor: PolledSensor[ForceReading] | None = None
    controller: Any = None
    drive: Any = None


def _unconnected(*_: Any) -> None:
    """Do nothing: the wire is not connected."""


class Wires(NamedTuple):
    """The connections to other processes.

    take_sample, take_force, take_command: wait until a time [ns] and return the newest message, or
    None.
    publish_sample, publish_force, publish_command: called with each reading and each command.
    read_inputs: passes the controller its other inputs at a time [ns]: set point, drive, resets.
    permission: a `drive.Permission`, which passes the supervisor's permission to the gate.
    publish_controller_state, publish_drive_state: called with a time [ns]; they publish when due.
    """

    take_sample: Callable[[int], EncoderReading | None] = _unconnected
    take_force: Callable[[int], ForceReading | None] = _unconnected
    take_command: Callable[[int], Command | None] = _unconnected
    publish_sample: Callable[[EncoderReading], None] = _unconnected
    publish_force: Callable[[ForceReading], None] = _unconnected
    publish_command: Callable[[EncoderReading, Any, int, int], None] = _unconnected
    read_inputs: Callable[[int], None] = _unconnected
    permission: Callable[[Any, int], None] = _unconnected
    publish_controller_state: Callable[[int], None] = _unconnected
    publish_drive_state: Callable[[int], None] = _unconnected


class VerticalLoop:
    """One robot's vertical axis, or a role of it; the caller repeats `step`."""

    def __init__(self, clock: Clock, period_ns: int, wires: Wires):
        self._clock, self._wires = clock, wires
        self._period_ns = period_ns
        self._ticker = Ticker(clock, period_ns)
        self._encoder_is_silent = False
        self._force_came = True  # during the last wait for it
        self._periods = 0

    def step(self, roles: Roles) -> None:
        """Do one period; whatever goes wrong in it, the drive gets a last zero."""
        try:
            self._step(roles)
        except BaseException:
            if roles.drive:
                roles.drive.release(self._clock.now_ns())
            raise

    def _step(self, roles: Roles) -> None:
        """Do one period. A controller alone has no ticks: samples are its clock."""
        encoder, force_sensor, controller, drive = roles
        if controller and not (encoder or force_sensor or drive):
            self._one_sample(controller)
            return
        if drive and not controller:
            self._follow_commands(drive)  # of another process, at once, until the next tick
        tick = self._ticker.sleep()
        due_ns = self._ticker.due_ns()
        for role in (encoder, force_sensor, drive):
            if role:
                role.begin(tick)
        sample, force = self._readings(roles, due_ns)
        if drive and not controller:
            drive.await_answer(tick)  # the permit needs this tick's statusword
        now_ns = self._clock.now_ns()
        output = self._act(roles, sample, force, now_ns)  # the torque first, then the topics
        self._publish(roles, sample, force, output)
        if drive:
            drive.end(tick, self._wires.permission)
            self._wires.publish_drive_state(tick.monotonic_ns)
        if controller:
            self._update_controller(controller, drive, now_ns)
        if force_sensor and force is None:
            # For the topic, and for the next step of the law.
            self._take_late_force(force_sensor, controller, due_ns)

    def _one_sample(self, controller: VerticalController) -> None:
        sample, force = self._received()
        now_ns = self._clock.now_ns()
        roles = Roles(controller=controller)
        self._act(roles, sample, force, now_ns)
        if sample is None and force is None:
            self._clock.sleep(BACK_OFF_S)
        self._update_controller(controller, None, now_ns)

    # Encoder and force sensor --------------------------------------------------------------

    def _readings(
        self, roles: Roles, due_ns: int
    ) -> tuple[EncoderReading | None, ForceReading | None]:
        """Return the readings of encoder and force sensor; the drive never waits for the force.

        If the encoder did not answer the last tick, the force sensor comes first: the wait for the
        encoder may take the whole period.
        """
        encoder, force_sensor = roles.encoder, roles.force_sensor
        sample = force = None
        force_first = self._encoder_is_silent
        if force_sensor and force_first:
            force = force_sensor.answer(self._clock.now_ns() + self._period_ns // 2)
        if encoder:
            sample = encoder.answer(due_ns)
            self._encoder_is_silent = sample is None
        if force_sensor and not force_first:
            force = self._force_answer(force_sensor, roles, due_ns)
        return sample, force

    def _force_answer(
        self, force_sensor: PolledSensor[ForceReading], roles: Roles, due_ns: int
    ) -> ForceReading | None:
        if not (roles.controller or roles.drive):
            return force_sensor.answer(due_ns)
        wait_ns = self._force_wait_ns() or _LOOK_NS
        force = force_sensor.answer(min(due_ns, self._clock.now_ns() + wait_ns))
        self._force_came = force is not None
        return force

    def _force_wait_ns(self) -> int:
        """Return how long to wait for the force of this tick [ns]; 0 if it is always late."""
        self._periods += 1
        worth_it = self._force_came or self._periods % _TRY_AGAIN == 0
        return round(_FORCE_WAIT * self._period_ns) if worth_it else 0

    def _received(self) -> tuple[EncoderReading | None, ForceReading | None]:
        """Return the newest samples; wait a moment for the force of the encoder's tick."""
        wires = self._wires
        sample = wires.take_sample(self._clock.now_ns() + _LISTENS * self._period_ns)
        force = wires.take_force(0)
        if sample is None or (force is not None and force.sequence == sample.sequence):
            return sample, force
        wait_ns = self._force_wait_ns()
        if not wait_ns:
            return sample, force
        newer = wires.take_force(self._clock.now_ns() + wait_ns)
        self._force_came = newer is not None
        return sample, newer or force

    def _take_late_force(
        self, force_sensor: PolledSensor[ForceReading], controller: VerticalController | None,
        due_ns: int,
    ) -> None:  # fmt: skip
        force = force_sensor.answer(due_ns)
        if force is None:
            return
        if controller:
            controller.on_force(force, self._clock.now_ns())
        self._wires.publish_force(force)

    # Law and torque ------------------------------------------------------------------------

    def _act(
        self, roles: Roles, sample: EncoderReading | None, force: ForceReading | None, now_ns: int
    ) -> VerticalOutput | None:
        """Turn the samples into torque; return the controller's output, or None.

        Without a usable sample the controller outputs zero once, in place of the last force.
        """
        controller = roles.controller
        if controller is None:
            return None
        if force is not None:
            controller.on_force(force, now_ns)
        output = controller.on_encoder(sample, now_ns) if sample is not None else None
        answers = output is not None
        if not answers:
            output = controller.stop_when_silent(now_ns)
        if output is not None:
            self._send(controller, roles.drive, output, now_ns)
        if answers:
            controller.count(self._clock.now_ns())
        return output

    def _send(
        self, controller: VerticalController, drive: VerticalDrive | None, output: VerticalOutput,
        now_ns: int,
    ) -> None:  # fmt: skip
        """Send the force to the drive, in this process or another."""
        behind, mode, activation = controller.answered, controller.mode, controller.activation
        assert behind is not None, "an output answers a sample"
        if drive:
            drive.act(behind.sequence, behind.monotonic_ns, output.force, now_ns, mode, activation)
        else:
            self._wires.publish_command(behind, output, mode, activation)

    def _follow_commands(self, drive: VerticalDrive) -> None:
        """Until the next tick, execute the commands of another process."""
        clock, due_ns = self._clock, self._ticker.due_ns()
        while clock.now_ns() < due_ns:
            command, now_ns = self._wires.take_command(due_ns), clock.now_ns()
            if command is not None:
                sequence, monotonic_ns, force, mode, activation = command
                drive.act(sequence, monotonic_ns, force, now_ns, mode, activation)
            elif now_ns < due_ns:
                clock.sleep_until(min(due_ns, now_ns + round(BACK_OFF_S * 1e9)))

    # After the torque ----------------------------------------------------------------------

    def _publish(
        self,
        roles: Roles,
        sample: EncoderReading | None,
        force: ForceReading | None,
        output: VerticalOutput | None,
    ) -> None:
        wires, controller = self._wires, roles.controller
        if sample is not None:
            wires.publish_sample(sample)
        if force is not None:
            wires.publish_force(force)
        if output is not None and roles.drive and controller and controller.answered:
            wires.publish_command(
                controller.answered, output, controller.mode, controller.activation
            )

    def _update_controller(
        self, controller: VerticalController, drive: VerticalDrive | None, now_ns: int
    ) -> None:
        """Pass drive state, set point and resets to the controller, after the command is sent."""
        if drive:
            controller.on_drive(drive.permit.enabled, drive.position, now_ns, drive.brakes)
        self._wires.read_inputs(now_ns)
        controller.end_tick(now_ns)
        self._wires.publish_controller_state(now_ns)
