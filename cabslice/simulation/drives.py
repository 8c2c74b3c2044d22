"""Motors that do not follow exactly: the cascade of a servo drive, beside the angles it is told.

Legend (Gueners 2021, 6.1; Le Flohic 2015, II.3)
    theta, omega   angle and speed of a motor (rad, rad/s);  *_c: as commanded
    Kp     position gain, 1/s           Kv    velocity gain, N mm s/rad (amperes times torque constant)
    Tv     reset time of the velocity loop, s
    tau    torque, N mm                 r     cable wound per motor angle, mm/rad        J  inertia, kg mm^2
    q      encoder step, rad            Ts    cycle of the drive, s

    velocity asked   v = Kp (theta_c - theta_m) + velocity feed-forward times omega_c,   theta_m = q round(theta/q)
    torque           tau = Kv (e + integral of e dt / Tv) + torque feed-forward times tau_c,   e = v - omega_m
omega_m is the speed seen by the encoder, quantised by q / Ts and averaged over eight cycles when q > 0. The current
loop is taken as ideal. The load is the planned tension: J domega/dt = tau - r t. What the platform does to the tension
beyond the plan (some per cent) is left out, so a drive can be played before the platform.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cabslice.arrays import Array
from cabslice.motors.block import Block
from cabslice.robot.model import WinderColumns
from cabslice.robot.winder import transmission
from cabslice.simulation.drives_kernel import follow


@dataclass(frozen=True)
class Drive:
    """One kind of drive for all motors. The thesis' gains: 2000 1/min, 0.480 A s/rad, 1 ms."""

    position_gain_1_s: float = 2000 / 60
    velocity_gain_n_mm_s: float = 480.0        # 0.480 A s/rad at a torque constant of 1 N m/A (assumed)
    reset_s: float = 1e-3
    cycle_s: float = 125e-6                    # of the velocity loop (assumed)
    velocity_feed_forward: float = 1.0
    torque_feed_forward: float = 1.0
    encoder_step_rad: float = 0.0


@dataclass(frozen=True)
class Followed:
    """What the motors did, at the rows of a block: all (n, m)."""

    angle: Array       # rad
    velocity: Array    # rad/s


class Drives:
    """Motors that play one block after the other, each beginning with the last row of the one before."""

    def __init__(self, drive: Drive, winders: WinderColumns, period_s: float) -> None:
        self.drive, self.winders = drive, winders
        self.cycles = max(1, round(period_s / drive.cycle_s))
        self.step_s = period_s / self.cycles
        self._state: Array | None = None

    def play(self, block: Block) -> Followed:
        """The first block begins with the motors at rest where they are told to be, holding the load."""
        load = transmission(self.winders, block.angle) * block.tension
        if self._state is None:
            self._state = np.zeros((block.angle.shape[1], 3 + 8))
            self._state[:, 0], self._state[:, 1] = block.angle[0], block.velocity[0]
            self._state[:, 2] = load[0] - self.drive.torque_feed_forward * block.torque[0]
        angle, velocity = np.empty((2, *block.angle.shape))
        gains = np.array([
            self.drive.position_gain_1_s, self.drive.velocity_gain_n_mm_s, self.drive.reset_s,
            self.drive.velocity_feed_forward, self.drive.torque_feed_forward, self.drive.encoder_step_rad])
        follow(np.ascontiguousarray(block.angle), np.ascontiguousarray(block.velocity),
               np.ascontiguousarray(block.torque), load, self.winders.inertia, gains, self.step_s, self.cycles,
               self._state, angle, velocity)
        return Followed(angle, velocity)

    def played(self, block: Block) -> Block:
        """The same block with the angles and velocities that the motors really had."""
        found = self.play(block)
        return replace(block, angle=found.angle, velocity=found.velocity)
