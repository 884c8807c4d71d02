# SPDX-License-Identifier: Apache-2.0
"""Both drives of the plane: SYNC and heartbeat on the tick, torques behind one gate.

::

    both torques -> permit -> heat of the motors -> both drives
"""

from __future__ import annotations

from contextlib import suppress

from ..can_io.port import Port
from ..control.limits import COLD, TorqueLimits, largest_torque
from ..devices import drive_group
from ..devices.drive import Drive
from ..devices.drive_settings import DriveSettings
from ..devices.errors import BusError
from ..devices.life import Phase
from ..safety.permit import Permit, PermitSettings


class Motor:
    """One motor. limits: of its torque; heat: [Nm^2], see `control.limits`."""

    def __init__(self, drive: DriveSettings, time_constant: float):
        """time_constant: of its heating [s]."""
        self.limits = TorqueLimits(drive.rated_torque, drive.max_torque, time_constant)
        self.heat = COLD

    @property
    def warmth(self) -> float:
        """Share of the heat that the motor bears for long, 0 to 1."""
        return self.heat / self.limits.continuous**2


class PlaneDrives:
    """Both drives and their motors; only the loop's thread calls it.

    pair: both; permit: their gate; motors: theirs. written: torques of the last tick [Nm]; hot:
    whether the motors' heat bounded them.
    """

    def __init__(
        self,
        drives: tuple[Drive, Drive],
        port: Port,
        period_ns: int,
        permit: PermitSettings,
        time_constant: float,
    ):
        """time_constant: of the motors' heating [s]."""
        self.permit = Permit(
            drives, permit, period_ns,
            max(drive.settings.enable_timeout for drive in drives),
        )  # fmt: skip
        shoulder, elbow = (Motor(drive.settings, time_constant) for drive in drives)
        self.motors = shoulder, elbow
        self.pair, self._port = drives, port
        self._period_ns = period_ns
        self._heat_ns = port.clock.now_ns()
        self.restart()

    def restart(self) -> None:
        """Nothing was written; the motors stay as warm as they are."""
        self.written = (0.0, 0.0)
        self.hot = False

    def warm_as(self, before: PlaneDrives) -> None:
        """Take over the heat of the motors, which do not cool by a new configuration."""
        self._heat_ns = before._heat_ns
        for motor, same in zip(self.motors, before.motors, strict=True):
            motor.heat = same.heat

    def request(self, now_ns: int) -> None:
        """Send SYNC and heartbeat; the heartbeat also when SYNC fails. Raises BusError."""
        shoulder, elbow = self.pair
        try:
            shoulder.sync(now_ns)
        finally:
            shoulder.heartbeat(now_ns)
            elbow.heartbeat(now_ns)  # the drives share one heartbeat

    def answered(self, since_ns: int) -> bool:
        """Return whether both drives have answered since `since_ns` [ns]."""
        for drive in self.pair:
            reading = drive.reading
            if reading is None or reading.monotonic_ns < since_ns:
                return False
        return True

    def await_answers(self, since_ns: int, due_ns: int) -> bool:
        """Return whether both drives answer, since `since_ns` and before `due_ns` [ns].

        Raises DeviceError.
        """
        while not self.answered(since_ns):
            if self._port.clock.now_ns() >= due_ns:
                return False
            self._port.pump(due_ns)
        return True

    @property
    def count_anew(self) -> bool:
        """Whether a drive may count from elsewhere after its recovery."""
        return any(each.unsound or each.phase is not Phase.RUNNING for each in self.pair)

    def write(self, wanted: tuple[float, float], command_ns: int, now_ns: int) -> None:
        """Write both torques [Nm] as the gate lets them pass, the second also if the first fails.

        command_ns: time of the positions behind them [ns]: their age is the command's age. Raises
        BusError, after both writes.
        """
        scale = self.permit.step(command_ns, now_ns)
        kept = self._cooled(now_ns, scale, wanted)
        written, failed = [0.0, 0.0], None
        for number, (drive, torque) in enumerate(zip(self.pair, wanted, strict=True)):
            try:
                written[number] = drive.write(kept * torque, now_ns)
            except BusError as error:  # the other drive still needs its command
                failed = failed or error
        self.written = written[0], written[1]
        if failed is not None:
            raise failed

    def _cooled(self, now_ns: int, scale: float, wanted: tuple[float, float]) -> float:
        """Take the heat of both motors to now; return the factor of the wanted torques [Nm].

        It is `scale`, or less where a motor is too hot: one factor keeps the force's direction.
        """
        elapsed = (now_ns - self._heat_ns) * 1e-9
        self._heat_ns = now_ns
        factor = scale
        for motor, acted, torque in zip(self.motors, self.written, wanted, strict=True):
            limits, size = motor.limits, abs(torque)
            motor.heat += (acted * acted - motor.heat) * min(1.0, elapsed / limits.time_constant)
            if factor * size > limits.continuous:
                largest = largest_torque(limits, motor.heat, self._period_ns * 1e-9)
                factor = min(factor, largest / size)
        self.hot = factor < scale
        return factor

    def release(self) -> None:
        """Close the gate and write zero, after an error that ends the loop."""
        self.permit.close()
        for drive in self.pair:
            with suppress(Exception):
                drive.write(0.0, self._port.clock.now_ns())

    def shutdown(self) -> str:
        """Shut both drives down cleanly after the loop has ended; return the errors."""
        self.permit.close()  # else the next start would report a stale command
        return drive_group.leave(self.pair, self._port)
