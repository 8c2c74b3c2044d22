"""The stages in order: part, layers, path, plan, motor file. Each takes the product before it, or any earlier one.

    read        a mesh file                      -> Placed
    read_gcode  another slicer's work            -> Laid
    to_layers   Placed                           -> Sliced    .layers
    to_path     Placed or Sliced                 -> Laid      .path
    to_plan     Placed, Sliced or Laid           -> Planned   .plan     and the Verdict that let it through
    to_stream   Planned, with its Verdict        -> MotorStream

A product carries its profiles, so a stage needs nothing but the product. A path is planned only where `check` found
nothing, and a stream is made only where the audit of the finished motion found nothing either.
"""

from cabslice.pipeline.headers import (
    numbers_of,
    refuse_format,
    stream_header,
)
from cabslice.pipeline.inputs import (
    GCODE,
    Foreign,
    Placed,
    Placement,
    origin_of,
    read,
    read_gcode,
)
from cabslice.pipeline.outputs import (
    circle,
    converted,
    save_gcode,
    save_stream,
    to_stream,
    trial,
)
from cabslice.pipeline.profiles import (
    Profiles,
    as_json,
    encoders,
    for_printer,
    load_profiles,
    matched,
    period_of,
    placement_of,
    profile_names,
    profiles_of,
    robot_for,
    robot_of,
)
from cabslice.pipeline.stages import (
    Progress,
    active_limits,
    at_speed,
    audited,
    best_turned,
    check,
    check_box,
    check_path,
    compared,
    freed,
    part_clearance,
    passed,
    planned,
    proven,
    silent,
    stream_of,
    taken_up,
    to_layers,
    to_path,
    to_plan,
    with_ends,
)

__all__ = [
    "GCODE", "Foreign", "Placed", "Placement", "Profiles", "Progress", "active_limits", "as_json", "at_speed",
    "audited", "best_turned", "check", "check_box", "check_path", "circle", "compared", "converted", "encoders",
    "for_printer", "freed", "load_profiles", "matched", "numbers_of", "origin_of", "part_clearance", "passed",
    "period_of", "placement_of", "planned", "profile_names", "profiles_of", "proven", "read", "read_gcode",
    "refuse_format", "robot_for", "robot_of", "save_gcode", "save_stream", "silent", "stream_header", "stream_of",
    "taken_up", "to_layers", "to_path", "to_plan", "to_stream", "trial", "with_ends",
]
