"""The modes of the platform in motion, compiled: one time after the other (legend in ringing)."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def ring(cell, force, step, drive, nozzle, shapes, dual, state, error):
    """Fill error (K, 3); state (2 F,), that of the first row, is moved on to the last."""
    modes = drive.shape[1]
    before, now, place = np.zeros(modes), np.zeros(modes), np.zeros(6)
    here = cell[0]
    for k in range(len(cell)):
        if cell[k] != here:
            for part in range(2):
                for i in range(6):
                    place[i] = 0.0
                    for f in range(modes):
                        place[i] += shapes[here, i, f] * state[part * modes + f]
                for f in range(modes):
                    total = 0.0
                    for i in range(6):
                        total += dual[cell[k], f, i] * place[i]
                    state[part * modes + f] = total
            here = cell[k]
        for f in range(modes):
            now[f] = drive[here, f, 0] * force[k, 0] + drive[here, f, 1] * force[k, 1] + drive[here, f, 2] * force[k, 2]
        if k > 0:
            for f in range(modes):
                q, rate, s = state[f], state[modes + f], step[here, f]
                state[f] = s[0] * q + s[1] * rate + s[2] * before[f] + s[3] * now[f]
                state[modes + f] = s[4] * q + s[5] * rate + s[6] * before[f] + s[7] * now[f]
        for i in range(3):
            total = 0.0
            for f in range(modes):
                total += nozzle[here, i, f] * state[f]
            error[k, i] = total
        before, now = now, before
