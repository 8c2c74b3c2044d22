"""How inner loops are compiled: once, kept beside the code, in plain scalars and arrays that they are given.

No arrays are made within such a loop, so nothing need be counted (_nrt=False): that halves the time of short loops and
takes a third off compiling them. Loops that do make arrays use numba.njit itself.
"""

from __future__ import annotations

from typing import Any

from numba import njit

compiled: Any = njit(cache=True, nogil=True, error_model="numpy", _nrt=False)  # type: ignore[call-overload]
