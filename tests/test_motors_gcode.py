"""G-code of motor angles, played by a firmware of a few lines that knows no more than the manuals say."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from motors_fakes import smooth_stream, whole

from cabslice.errors import UsageError
from cabslice.motors.formats import FORMATS, klipper, motor_gcode, reprap
from cabslice.motors.formats.chords import chords
from cabslice.motors.stream import MotorStream

EACH = pytest.mark.parametrize("name", ["reprap", "klipper"])
DIALECT = {"reprap": reprap.DIALECT, "klipper": klipper.DIALECT}


def words_of(line):
    return {word[0]: float(word[1:]) for word in line.split(";")[0].split()[1:]}


def played(text, letters, name):
    """Time (K,) s, positions (K, letters) and the other commands with the time they come at."""
    at, time, positions, others = dict.fromkeys(letters, 0.0), [0.0], [], []
    for line in text.splitlines():
        code = line.split(" ")[0]
        if code in ("G92", "G1"):
            words = words_of(line)
            steps = [words[letter] - at[letter] for letter in letters if letter in words]
            at |= {letter: words[letter] for letter in letters if letter in words}
            if code == "G1":
                minutes = 1 / words["F"] if name == "reprap" else max(map(abs, steps)) / words["F"]
                time.append(time[-1] + 60 * minutes)
                positions.append([*at.values()])
        elif code == "MANUAL_STEPPER":
            given_ = dict(word.split("=") for word in line.split()[1:])
            letter = letters[int(given_["STEPPER"].removeprefix("winder_")) - 1]
            at[letter] = float(given_.get("SET_POSITION", at[letter]))
            assert given_.get("GCODE_AXIS", letter) == letter
        elif code == "G4":
            time.append(time[-1] + words_of(line)["P"] / 1e3)
            positions.append([*at.values()])
        elif code and not line.startswith(";"):
            others.append((time[-1], line))
        if not positions and code in ("G92", "MANUAL_STEPPER"):
            start = [*at.values()]
    return np.array(time), np.array([start, *positions]), others


def resting(rows=9000, cables=3, rest=(4000, 4400)):
    """A stream that stands still for a while, with events."""
    base = whole(smooth_stream(rows, cables=cables))
    index = np.concatenate((np.arange(rest[0]), np.full(rest[1] - rest[0], rest[0]), np.arange(rest[0], rows)))[:rows]
    header = dict(smooth_stream(rows, cables=cables).header)
    header["start_angles_rad"] = base.angle[0].tolist()
    header["events"] = {"t_s": [0, 0, 3, 8.4, 9], "row": [0, 0, 1500, 4200, 4500], "value": [210, 60, 0.5, 0, 0.4],
                        "kind": ["nozzle_c", "bed_c", "fan", "pause", "dwell"]}
    from cabslice.motors.stream import Block

    block = Block(0, base.angle[index], base.velocity[index], base.torque[index], base.tension[index],
                  base.filament[index], feed=base.feed[index])
    return MotorStream(header, lambda: iter([block])), block


@EACH
def test_a_simple_firmware_plays_the_rows(name, tmp_path):
    """Angles, filament and time of every row within the tolerance and the last digit, through rests and blocks."""
    stream, block = resting()
    path = tmp_path / f"a{FORMATS[name].suffix}"
    FORMATS[name].write(stream, path)
    letters = [*DIALECT[name].letters[:3], "E"]
    time, positions, others = played(path.read_text(), letters, name)
    assert time[-1] == pytest.approx((stream.rows - 1) * stream.period_s, abs=1e-4)
    assert len(time) < stream.rows, "fewer lines than rows"
    rows = np.arange(stream.rows) * stream.period_s
    angle, fed, _ = motor_gcode.tolerances(stream.header)
    for column, wanted, tolerance in zip(positions.T, [*(block.angle.T * 180 / np.pi), block.filament],
                                         [angle * 180 / np.pi] * 3 + [fed], strict=True):
        assert np.abs(np.interp(rows, time, column) - wanted).max() <= tolerance + 1e-3
    told = [(round(t, 3), line) for t, line in others if line.startswith(("M", "PAUSE")) and line != "M82"]
    assert told == [(0, "M109 S210"), (0, "M190 S60"), (3.0, "M106 S128"),
                    (8.4, {"reprap": "M226", "klipper": "PAUSE"}[name])]
    standing = np.abs(time - 8.4).argmin()
    np.testing.assert_array_equal(positions[standing], positions[standing + 1])


@EACH
@given(rows=st.integers(2, 60), cables=st.integers(1, 9), seed=st.integers(0, 99), friction=st.sampled_from([0, 150]))
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_columns_come_back_within_the_tolerance(name, tmp_path, rows, cables, seed, friction):
    rows = rows + 8180 if seed % 7 == 0 else rows
    stream = smooth_stream(rows, cables=cables, seed=seed, friction=friction)
    path = tmp_path / f"a{FORMATS[name].suffix}"
    FORMATS[name].write(stream, path, overwrite=True)
    found, wanted = whole(FORMATS[name].read(path)), whole(stream)
    bounds = dict(zip(("angle", "filament", "tension"), motor_gcode.tolerances(stream.header), strict=True))
    for column, bound in bounds.items():
        assert np.abs(getattr(found, column) - getattr(wanted, column)).max() <= bound * (1 + 1e-9), column
    assert np.abs(found.velocity - wanted.velocity).max() <= bounds["angle"] / 0.002 * (1 + 1e-9)


@given(seed=st.integers(0, 999), rows=st.integers(2, 90))
@settings(deadline=None)
def test_chords_pass_every_row_and_stop_where_they_must(seed, rows):
    rng = np.random.default_rng(seed)
    values = np.cumsum(rng.normal(0, 1, (rows, 2)), axis=0)
    tol, forced = np.array([0.5, 2.0]), rng.random(rows) < 0.05
    at = chords(values, tol, forced)
    assert at[0] == 0
    assert at[-1] == rows - 1
    assert set(np.flatnonzero(forced)) <= set(at)
    for column, limit in zip(values.T, tol, strict=True):
        assert np.abs(np.interp(np.arange(rows), at, column[at]) - column).max() <= limit * (1 + 1e-9)
    line = np.outer(np.arange(rows), [0.3, -2.0])
    np.testing.assert_array_equal(chords(line, tol * 1e-6, np.zeros(rows, bool)), [0, rows - 1])


@EACH
def test_the_head_configures_the_machine(name):
    header = {**smooth_stream(5, cables=2).header, "start_angles_rad": [np.pi, -np.pi / 2]}
    text = motor_gcode.head(DIALECT[name], header).decode()
    speed = 10.5 * 180 / np.pi
    wanted = {
        "reprap": [f"; M92 X{2**20 / 360:.6f} Y{2**20 / 360:.6f}", "; M669 K0", f"; M203 X{60 * speed:.3f}", "\nG93\n",
                   "; M584 X0 Y1 S0 E2", f"; M208 X{-1000 * 180 / np.pi:.3f}"],
        "klipper": ["; kinematics: none", f"; full_steps_per_rotation: {2**20}",
                    "STEPPER=winder_2 SET_POSITION=-90.0000",
                    f"STEPPER=winder_1 GCODE_AXIS=A LIMIT_VELOCITY={speed:.3f}"],
    }[name]
    for line in wanted:
        assert line in text
    with pytest.raises(UsageError, match="axes, not 13"):
        FORMATS[name].refuse({"cables": 13})
