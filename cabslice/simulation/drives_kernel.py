"""The drive cascade of every motor, compiled: one motor, one cycle at a time (legend in drives)."""

from __future__ import annotations

from math import floor

from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def follow(command, speed, torque, load, inertia, gains, step, cycles, state, angle, velocity):
    """Fill angle, velocity (n, m) with what the motors do; state (m, 11) is moved on to the last row.

    state of a motor: theta, omega, integral part of the torque, and the angle the encoder saw in the last eight cycles.
    """
    kp, kv, reset, ahead, push, q = gains
    for i in range(command.shape[1]):
        theta, omega, integral = state[i, 0], state[i, 1], state[i, 2]
        angle[0, i], velocity[0, i] = theta, omega
        seen, turn = state[i, 3:], 0
        for k in range(8):
            seen[k] = theta - (8 - k) * step * omega
        for row in range(len(command) - 1):
            for cycle in range(cycles):
                share = cycle / cycles
                wanted, fast = _hermite(command, speed, row, i, share, step * cycles)
                measured = q * floor(theta / q + 0.5) if q > 0.0 else theta
                rate = (measured - seen[turn]) / (8 * step) if q > 0.0 else omega
                seen[turn] = measured
                turn = (turn + 1) % 8
                miss = kp * (wanted - measured) + ahead * fast - rate
                integral += kv * miss * step / reset
                given = (1 - share) * torque[row, i] + share * torque[row + 1, i]
                held = (1 - share) * load[row, i] + share * load[row + 1, i]
                gain = 1e3 * (kv * miss + integral + push * given - held) / inertia[i]
                theta += step * (omega + 0.5 * step * gain)
                omega += step * gain
            angle[row + 1, i], velocity[row + 1, i] = theta, omega
        state[i, 0], state[i, 1], state[i, 2] = theta, omega, integral


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _hermite(value, rate, row, i, s, period):
    """Value and rate at a share s of the row, on the cubic through values and rates."""
    r = 1.0 - s
    v0, v1, g0, g1 = value[row, i], value[row + 1, i], rate[row, i], rate[row + 1, i]
    return (r * r * (1 + 2 * s) * v0 + s * s * (1 + 2 * r) * v1 + period * s * r * (r * g0 - s * g1),
            6 * s * r * (v1 - v0) / period + r * (1 - 3 * s) * g0 + s * (3 * s - 2) * g1)
