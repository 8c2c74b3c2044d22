"""How cables stretch, damp and creep: what a profile's tables say beyond a constant modulus.

Legend (Gueners 2021, ch. 4: viscoanalyser, load cycles and relaxation of steel, Dyneema and aramid)
    t, s, n    pull of a cable on the platform, N; of one of its n strands, s = t/n
    E, ES      modulus; axial stiffness, the slope dt/d(strain), N, of all strands: n times that of one
    f, omega   frequency of the vibration about the preload, Hz; 2 pi f
    l, l0      loaded and rest length, mm        e    strain, l/l0 - 1
    eta S      viscosity times section, N s: N per 1/s of strain, of all strands;  c = eta S/l0, N s/mm
    T          time since tensioning, s          D    share of the tension lost, at constant length

ES(t, f) = ES_0 [E(s)/E_0] [E(f)/E_0]: E_0 is modulus_gpa; preload and frequency are taken to act apart (assumed).
e(t) = integral of dt/ES(t) from 0: the rest length of a cable whose modulus rises with the pull.
Kelvin-Voigt: t = max(0, ES e + c dl/dt): a cable never pushes.
Creep: D(T) = D_1 ln(1 + T/T_0)/ln(1 + T_1/T_0): in proportion to time up to the onset T_0, then with its logarithm, as
aramid ropes do (Guimaraes and Burgoyne 1992, J. Mater. Sci. 27, 2473; taken for Dyneema too). D_1 is measured at T_1.
A load cycle of area A, swing 2 F and stiffness k turns A of its energy into heat: loss factor A k/(pi F^2), and a
Kelvin-Voigt cable that does the same at frequency f has c = A k^2/(pi omega F^2).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from cabslice.arrays import Array, Shapes, set_columns


@dataclass(frozen=True)
class Curve:
    """A table read between its points: straight over x, or over log x (then y is positive); constant beyond."""

    x: Array             # (n,) rising
    y: Array             # (n,)
    log_x: bool = False
    log_y: bool = False

    def __post_init__(self) -> None:
        shape = Shapes("Curve")
        set_columns(self, x=shape.column("x", self.x, "n"), y=shape.column("y", self.y, "n"))
        if not (np.diff(self.x) > 0).all():
            raise ValueError("Curve.x: expected numbers that rise")

    def at(self, x: Array) -> Array:
        """y at x, of any shape."""
        given, known = (np.log(x), np.log(self.x)) if self.log_x else (x, self.x)
        found = np.interp(given, known, np.log(self.y) if self.log_y else self.y)
        return np.exp(found) if self.log_y else found


@dataclass(frozen=True)
class CableLaws:
    """What is known of m cables beyond a constant modulus; None: nothing, there the constant holds."""

    axial_stiffness: Array                       # (m,) N, ES_0 of all strands
    strands: Array                               # (m,)
    by_tension: tuple[Curve | None, ...]         # factor on ES_0 over the pull of one strand, N
    by_frequency: tuple[Curve | None, ...]       # factor on ES_0 over f, Hz
    viscosity: tuple[Curve | None, ...]          # eta S of one strand, N s, over f
    loss: Array                                  # (m,) D_1; 0: no creep
    after: Array                                 # (m,) T_1, s
    onset: Array                                 # (m,) T_0, s

    def __post_init__(self) -> None:
        shape = Shapes("CableLaws")
        names = ("axial_stiffness", "strands", "loss", "after", "onset")
        set_columns(self, **{name: shape.column(name, getattr(self, name), "m") for name in names})


def laws_from_printer(printer: Any, axial_stiffness: Array) -> CableLaws:
    """The laws of a printer profile's cables; axial_stiffness (m,) N as in its robot (robot.model)."""
    cables = printer.cable
    creep = [cable.creep for cable in cables]
    return CableLaws(
        axial_stiffness=axial_stiffness,
        strands=np.array([cable.winder.mechanical_advantage if cable.winder else 1 for cable in cables], float),
        by_tension=tuple(_factors(cable, cable.modulus_by_tension, "tension_n") for cable in cables),
        by_frequency=tuple(_factors(cable, cable.modulus_by_frequency, "frequency_hz") for cable in cables),
        viscosity=tuple(_viscosity(cable.damping) for cable in cables),
        loss=np.array([one.loss if one else 0.0 for one in creep]),
        after=np.array([one.after_s if one else 1.0 for one in creep]),
        onset=np.array([one.onset_s if one else 1.0 for one in creep]),
    )


def _factors(cable: Any, table: Any, over: str) -> Curve | None:
    if table is None:
        return None
    factor = np.array(table.modulus_gpa) / cable.modulus_gpa
    return Curve(np.array(getattr(table, over)), factor, log_x=over == "frequency_hz")


def _viscosity(table: Any) -> Curve | None:
    return None if table is None else Curve(
        np.array(table.frequency_hz), np.array(table.damping_n_s), log_x=True, log_y=True)


def axial_stiffness(laws: CableLaws, tension: Array, frequency_hz: float | None = None) -> Array:
    """ES (K, m) N of cables that pull with `tension` (K, m) N and vibrate at frequency_hz (None: as modulus_gpa).

    The stiffness to small changes of the pull: what robot.stiffness and the modes need.
    """
    stiff = laws.axial_stiffness * _each(laws.by_tension, np.asarray(tension, float) / laws.strands, 1.0)
    if frequency_hz is None:
        return stiff
    return stiff * _each(laws.by_frequency, np.full(stiff.shape, frequency_hz), 1.0)


def strain(laws: CableLaws, tension: Array) -> Array:
    """Strain (K, m) of cables that pull with `tension` (K, m) >= 0 N, slowly loaded: the integral of dt/ES(t)."""
    tension = np.asarray(tension, float)
    out = tension / laws.axial_stiffness
    for cable, curve in enumerate(laws.by_tension):
        if curve is not None:
            ratio = laws.strands[cable] / laws.axial_stiffness[cable]
            out[:, cable] = ratio * _inverse_integral(curve, tension[:, cable] / laws.strands[cable])
    return out


def rest_lengths(laws: CableLaws, loaded: Array, tension: Array) -> Array:
    """Rest lengths (K, m) mm of cables that are `loaded` (K, m) mm long at `tension` (K, m) N."""
    return loaded / (1 + strain(laws, tension))


def damping(laws: CableLaws, rest: Array, frequency_hz: float) -> Array:
    """Kelvin-Voigt c = eta S/l0 (K, m) N s/mm of cables of rest length `rest` (K, m) mm; 0 where nothing is known."""
    rest = np.asarray(rest, float)
    return laws.strands * _each(laws.viscosity, np.full(rest.shape, frequency_hz), 0.0) / rest


def pull(axial_stiffness: Array, c: Array, rest: Array, loaded: Array, rate: Array) -> Array:
    """Pull (K, m) N of Kelvin-Voigt cables: ES (l/l0 - 1) + c dl/dt, never below 0.

    ES in N, c in N s/mm, lengths in mm, rate dl/dt in mm/s; broadcast. Source: Gueners 2021, 3.2.3.
    """
    return np.maximum(0.0, axial_stiffness * (loaded / rest - 1) + c * rate)


def loss(laws: CableLaws, since_s: Array) -> Array:
    """Share D (K, m) of the tension lost at times since_s (K,) s since tensioning, lengths held."""
    since = np.asarray(since_s, float)[:, None]
    return laws.loss * np.log1p(since / laws.onset) / np.log1p(laws.after / laws.onset)


def tension_left(laws: CableLaws, tension: Array, since_s: Array) -> Array:
    """What is left (K, m) N of `tension` (K, m) or (m,) at times since_s (K,) s, lengths held; never below 0."""
    return np.asarray(tension, float) * np.maximum(0.0, 1 - loss(laws, since_s))


def crept_rest(laws: CableLaws, rest: Array, tension: Array, since_s: Array) -> Array:
    """Rest lengths (K, m) mm that cables of `rest` (K, m), tensioned with `tension` (K, m), have after since_s (K,).

    As much longer as explains the loss at constant loaded length: what a controller must wind in.
    """
    return rest * (1 + strain(laws, tension)) / (1 + strain(laws, tension_left(laws, tension, since_s)))


def time_to_lose(laws: CableLaws, share: float) -> Array:
    """Times (m,) s since tensioning after which `share` of the tension is lost; inf without creep."""
    with np.errstate(divide="ignore", over="ignore"):
        exponent = share / laws.loss * np.log1p(laws.after / laws.onset)
        return laws.onset * np.expm1(exponent)


def loss_factor(area: Array, stiffness: Array, swing: Array) -> Array:
    """Loss factor of load cycles of area N mm, stiffness N/mm and swing (largest less smallest pull) N; broadcast."""
    return area * stiffness / (np.pi * (np.asarray(swing, float) / 2) ** 2)


def loop_damping(area: Array, stiffness: Array, swing: Array, frequency_hz: Array) -> Array:
    """c, N s/mm, of the Kelvin-Voigt sample that turns as much into heat as a load cycle at frequency_hz; broadcast."""
    return loss_factor(area, stiffness, swing) * stiffness / (2 * np.pi * np.asarray(frequency_hz, float))


def _each(curves: tuple[Curve | None, ...], x: Array, default: float) -> Array:
    """Each cable's curve at its column of x (K, m)."""
    out = np.full(x.shape, default)
    for cable, curve in enumerate(curves):
        if curve is not None:
            out[:, cable] = curve.at(x[:, cable])
    return out


def _inverse_integral(curve: Curve, x: Array) -> Array:
    """Integral of 1/y from 0 to x (K,), exact for straight pieces: width times the logarithmic mean's inverse."""
    edges = np.concatenate((np.zeros(1), curve.x[curve.x > 0], np.full(1, np.inf)))
    total = np.zeros(x.shape)
    for low, high in itertools.pairwise(edges):
        end = np.clip(x, low, high)
        width, first, last = end - low, curve.at(np.full(1, low)), curve.at(end)
        rise = last / first - 1
        total += width / first * np.where(np.abs(rise) < 1e-8, 1 - rise / 2, np.log1p(rise) / np.where(rise, rise, 1.0))
    return total
