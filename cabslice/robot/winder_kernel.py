"""Compiled inner loop of winder.motor_angles: one winder after the other, in plain scalars (legend in winder).

numpy takes 2.5 us a sample for this with 8 winders; compiled, with each sample started from the one before, 0.5 us.
"""

from __future__ import annotations

from math import atan2, nan, sqrt

from cabslice.compiled import compiled

TOLERANCE, MOST = 1e-10, 20     # mm, of the cable on the winder; steps


@compiled
def _unwound(pieces, i, piece, on):
    """Piece and spool angle with `on` mm on winder i: pieces (5, m, n) are phi, radius, rate, slope and wound."""
    last = pieces.shape[2] - 1
    while piece < last and on >= pieces[4, i, piece + 1]:
        piece += 1
    while piece > 0 and on < pieces[4, i, piece]:
        piece -= 1
    y, rate = on - pieces[4, i, piece], pieces[2, i, piece]
    return piece, pieces[0, i, piece] + 2.0 * y / (rate + sqrt(rate * rate + 2.0 * pieces[3, i, piece] * y))


@compiled
def wind(goal, strain, pieces, winders, angle, lever):
    """Fill angle (K, m) rad and lever (K, m) mm/rad; nan where winder and pulley overlap or no angle was found.

    goal, strain (K, m): on + line / strain = goal; pieces (5, m, n); winders (m, 10): gear, advantage, axial, home
    angle of the spool, pulley radius, side, EM squared, its direction, constant line (where EM is nan), line at home.
    """
    for i in range(goal.shape[1]):
        gear, advantage, axial, home = winders[i, 0], winders[i, 1], winders[i, 2], winders[i, 3]
        pulley, side, square, aim = winders[i, 4], winders[i, 5], winders[i, 6], winders[i, 7]
        known, piece, line = square == square, 0, winders[i, 9]
        for k in range(goal.shape[0]):
            on, step, left = goal[k, i] - line / strain[k, i], 1.0, MOST
            while left > 0 and abs(step) > TOLERANCE + 4e-16 * abs(on):
                piece, phi = _unwound(pieces, i, piece, on)
                slope = pieces[3, i, piece]
                reach = pieces[1, i, piece] + slope * (phi - pieces[0, i, piece])
                rate, climb, line = sqrt(reach * reach + axial * axial), 0.0, winders[i, 8]
                if known:
                    c, offset = pulley - side * reach, axial * (phi - home)
                    flat = sqrt(square - c * c) if square > (pulley + reach) ** 2 else nan
                    tangent = sqrt(flat * flat + offset * offset)
                    tilt = aim - atan2(c, flat)
                    line = tangent - c * tilt
                    climb = side * (tilt + c * (1.0 / tangent - 1.0 / flat)) * slope + offset / tangent * axial
                step = (on + line / strain[k, i] - goal[k, i]) / (1.0 + climb / (rate * strain[k, i]))
                on, left = on - step, left - 1
            if left > 0 and on == on:
                piece, phi = _unwound(pieces, i, piece, on)
                reach = pieces[1, i, piece] + pieces[3, i, piece] * (phi - pieces[0, i, piece])
                angle[k, i], lever[k, i] = phi * gear, sqrt(reach * reach + axial * axial) / (gear * advantage)
            else:
                angle[k, i] = lever[k, i] = nan
                piece, line = 0, winders[i, 9]
