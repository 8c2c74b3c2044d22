"""What an audit has seen: the largest share of each limit and where, and all places that a slower motion would mend."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cabslice.arrays import Array

ROUNDING = 1e-6             # of a limit: finite differences are not exact
TIGHTEST = 10_000
CURED_BY_SLOWING = {
    "speed", "feature-speed", "acceleration", "flow", "filament-speed", "filament-step", "tension", "path", "vertex",
    "motor-speed", "motor-torque", "carriage-acceleration",
}


@dataclass
class Worst:
    """Largest share of each limit seen so far, and where: code -> (share, value, limit, time, move, cable)."""

    seen: dict[str, tuple[float, float, float, float, int, int]] = field(default_factory=dict)
    vertices: int = 0      # passed so far
    squares: Array | float = 0.0     # (m,) sum of motor torque^2 over `rows` samples, (N m)^2
    rows: int = 0
    broken: list[tuple[Array, Array]] = field(default_factory=list)   # times and shares above 1 that slowing down cures
    tight: list[tuple[Array, Array]] = field(default_factory=list)    # largest shares of a tension, and when
    again: int = 0         # samples whose tensions were found by another method too

    def see(self, code: str, value: Array, limit: Array, times: Array, move: Array, cable: int = 0) -> None:
        if not len(value):
            return
        limit = np.broadcast_to(limit, value.shape)
        share = np.where(value > 0, value / np.maximum(limit, 1e-300), 0.0)
        share = np.where(np.isnan(value), np.inf, share)
        at = int(np.argmax(share))
        entry = (float(share[at]), float(value[at]), float(limit[at]), float(times[at]), int(move[at]), cable)
        if code not in self.seen or not entry[0] <= self.seen[code][0]:
            self.seen[code] = entry
        if code in CURED_BY_SLOWING and not entry[0] <= 1 + ROUNDING:
            over = ~(share <= 1 + ROUNDING)
            self.broken.append((times[over], share[over]))

    def see_cables(self, code: str, value: Array, limit: Array, times: Array, move: Array) -> None:
        """As see, of value (K, m) and limit (m,) of every cable or its motor."""
        share = np.where(np.isnan(value), np.inf, value / np.maximum(limit, 1e-300))
        at, cable = divmod(int(np.argmax(share)), len(limit))
        worst = float(share[at, cable])
        if code not in self.seen or not worst <= self.seen[code][0]:
            number = float(value[at, cable]), float(limit[cable]), float(times[at]), int(move[at]), cable + 1
            self.seen[code] = (worst, *number)
        if code in CURED_BY_SLOWING and not worst <= 1 + ROUNDING:
            rows, cables = np.nonzero(~(share <= 1 + ROUNDING))
            self.broken.append((times[rows], share[rows, cables]))

    def see_tight(self, share: Array, times: Array) -> None:
        """Keeps the times (K,) whose tensions have the largest share (K, m)."""
        self.tight.append((share.max(axis=1), times))
        self._keep_tightest()

    def tightest(self) -> tuple[Array, Array]:
        """The TIGHTEST largest shares seen, and their times."""
        none = np.zeros(0)
        return self.tight[0] if self.tight else (none, none)

    def _keep_tightest(self) -> None:
        share, times = (np.concatenate([one[k] for one in self.tight]) for k in (0, 1))
        if len(share) > TIGHTEST:
            kept = np.argpartition(-share, TIGHTEST)[:TIGHTEST]
            share, times = share[kept], times[kept]
        self.tight = [(share, times)]

    def merge(self, other: Worst) -> None:
        self.vertices += other.vertices
        self.squares, self.rows = self.squares + other.squares, self.rows + other.rows
        self.broken += other.broken
        if other.tight:
            self.tight += other.tight
            self._keep_tightest()
        for code, entry in other.seen.items():
            if code not in self.seen or not entry[0] <= self.seen[code][0]:
                self.seen[code] = entry
