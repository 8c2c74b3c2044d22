"""What the audit looks at, in words: unit, sentence and advice of each of its codes."""

from __future__ import annotations

UNITS = {"speed": "mm/s", "feature-speed": "mm/s", "acceleration": "mm/s^2", "flow": "mm^3/s", "filament-speed": "mm/s",
         "filament-step": "mm/s", "tension": "N", "path": "mm", "vertex": "mm", "filament": "mm", "rest": "mm/s",
         "missed": "", "dwell": "s", "layer-time": "s", "pause": "", "turn": "rad",
         "motor-speed": "rad/s", "motor-torque": "N m", "motor-heat": "N m",
         "tension-again": "N", "filament-at-vertex": "mm", "pressure-advance": "mm",
         "stroke": "mm", "arm-angle": "deg", "carriage-acceleration": "mm/s^2"}

SENTENCES = {
    "speed": "the nozzle moves faster than the machine may",
    "feature-speed": "the nozzle moves faster than asked for this feature",
    "acceleration": "the nozzle accelerates more than the machine may",
    "flow": "more plastic is asked for than the hot end melts",
    "filament-speed": "the filament is fed faster than the extruder may",
    "filament-step": "the feed of filament steps harder than the extruder follows",
    "tension": "no cable tensions within bounds produce this motion",
    "path": "the nozzle leaves the toolpath by more than the corner tolerance",
    "vertex": "a vertex of the toolpath is passed too far away",
    "tension-again": "two methods find other tensions for the same motion",
    "filament-at-vertex": "more or less filament is fed at a vertex than the toolpath says",
    "pressure-advance": "the filament is not ahead by its speed times extruder.pressure_advance_s",
    "filament": "filament was lost",
    "missed": "a part of the toolpath is not passed",
    "dwell": "a pause that was asked for is missing",
    "motor-speed": "a motor turns faster than it may, winding and taking up the stretch of its cable",
    "motor-torque": "a motor gives more than its peak torque",
    "motor-heat": "a motor gives more than its continuous torque in the mean of squares over the print",
    "stroke": "a carriage leaves its rail, counted from the middle of its travel",
    "arm-angle": "an arm leans more than its joints allow",
    "carriage-acceleration": "a carriage accelerates more than it may",
    "layer-time": "a layer is over sooner than it may be",
    "pause": "a pause is asked for where the nozzle does not rest",
    "rest": "a piece does not start and end at rest",
    "turn": "the platform is turned otherwise than it was checked",
}

UNKEPT = "report this: the plan should have kept it"
ADVICE = {
    "tension": "lower motion.max_acceleration_mm_s2, or move the part towards the middle of the bed",
    "motor-speed": "lower motion.max_acceleration_mm_s2, or raise motion.smoothing_ms",
    "motor-torque": "lower motion.max_acceleration_mm_s2, or raise motion.smoothing_ms",
    "motor-heat": "lower cables.reference_tension_n, or use motors of more continuous_torque_n_m",
}
