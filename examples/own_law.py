# SPDX-License-Identifier: Apache-2.0
"""A law of one's own on the simulated module, without ROS: what does the patient feel?"""

from math import pi

from screw_module_ros.plant.patient import ArmSettings
from screw_module_ros.plant.world import World, load_world

STIFFNESS, DAMPING, MIDDLE, WEIGHT = 100.0, 5.0, 0.18, 10.0  # N/m, Ns/m, m, N
GAIN = 4.0  # of the hand's force; with the thesis's 5 this module chatters where no guard watches
CUTOFF = 30.0  # of the force filter [Hz]
TICK, FORCE_TO_CURRENT = 1e-3, 0.01905 / (2 * pi) / 0.16  # [s]; lead [m], Nm/A
MOVES = ArmSettings("active", target=(0.0, 0.0, MIDDLE), amplitude=(0, 0, 0.05), omega=(0, 0, 2.0),
                    duration=1.0)  # fmt: skip


def law(position: float, velocity: float, hand: float) -> float:
    """Return the motor's force on the nut [N]. hand: force of the patient on the robot [N]."""
    spring = STIFFNESS * (MIDDLE - position) - DAMPING * velocity
    return WEIGHT + spring + GAIN * (spring + hand)


def felt(law, seconds: float = 6.0):
    """Yield time [s], position [m], force of the patient and of an ideal spring [N]."""
    world = World(load_world(), seed=1)
    world.vertical_powered = True
    world.set_arm(MOVES)
    hand = 0.0
    for tick in range(round(seconds / TICK)):
        now = world.truth()  # true values; a driver has `encoder_count` and `wrench()`
        hand += (now.patient_force - hand) * 2 * pi * CUTOFF * TICK
        force = law(now.nut_position, now.nut_velocity, hand)
        world.vertical_command = force * FORCE_TO_CURRENT
        world.advance(TICK)
        ideal = STIFFNESS * (now.handle_position - MIDDLE) + DAMPING * now.handle_velocity
        yield tick * TICK, now.handle_position, now.patient_force, ideal


if __name__ == "__main__":
    for time, position, force, ideal in list(felt(law))[::500]:
        print(f"{time:4.1f} s  {position:.3f} m  {force:+6.1f} N  (ideal {ideal:+6.1f} N)")
