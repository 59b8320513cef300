"""G-code: holes as G81 and G83, run by LinuxCNC and read back."""

import re
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from camgen.model.program import Comment, Instruction, MoveC, MoveJ, MoveL, Output, Wait
from tests.support.gcode_programs import gcode, read
from tests.support.rs274 import assert_moves, at, difference, needs_rs274, posted, program, run


def hole(x, y, *levels, near=2.0, feed=5.0, between: tuple[Instruction, ...] = ()):
    """The motions of a hole as `camgen.lower` makes them: pecks, up to the face, and up."""
    body = [Comment("path c1 layer 0"), MoveJ(at(x, y, 20), 100.0), MoveJ(at(x, y, near), 100.0)]
    body += [*([MoveL(at(x, y, 0), feed)] if near else []), *between]
    for k, level in enumerate(levels):
        if k:
            body += [MoveL(at(x, y, near), 100.0), MoveL(at(x, y, levels[k - 1] + 0.254), 100.0)]
        body.append(MoveL(at(x, y, level), feed))
    return [*body, MoveL(at(x, y, 0), 100.0), MoveJ(at(x, y, 20), 100.0)]


def kinds(body):
    return [type(item) for item in body]


def print_and_read(*body, **options):
    """Prints a program and compares its reading with it.

    Returns the lines with motions after the preamble, the prepared program, and the text.
    """
    ready, text = posted(gcode(**options), program(*body))
    reading = read(text, **options)
    assert not difference(ready, reading, gcode().tolerance())
    lines = [line for line in text.splitlines() if re.match(r"G[0-9]|X", line)]
    return lines[lines.index("G0 Z50") + 1 :], ready, text


def test_holes_of_one_depth_share_a_cycle():
    lines, ready, text = print_and_read(
        *hole(5, 6, -1.6), *hole(9, 6, -1.6), *hole(9, 2, -3), MoveJ(at(0, 0, 50), 100.0)
    )
    assert lines == [
        "G0 X5 Y6 Z20",
        "G98 G81 X5 Y6 Z-1.6 R2 F300",
        "X9 Y6",
        "G80",
        "G98 G81 X9 Y2 Z-3 R2",
        "G80",
        "G0 X0 Y0 Z50",
    ]
    assert text.count("(path c1 layer 0)") == 3
    # Only the stops at the face, on the motions down and up, are missing.
    assert [m.target.origin for m in ready.columns.moves[1:5]] == [
        (5, 6, 20),
        (5, 6, 2),
        (5, 6, -1.6),
        (5, 6, 20),
    ]


def test_pecks_that_retract_to_the_approach_height_are_g83():
    lines, _, _ = print_and_read(*hole(5, 6, -1, -4, -7, -9), *hole(8, 6, -1, -4, -7, -9))
    assert lines == ["G0 X5 Y6 Z20", "G98 G83 X5 Y6 Z-9 R2 Q3 F300", "X8 Y6", "G80"]


def test_a_peck_that_divides_the_depth_has_no_last_peck_of_length_0():
    lines, _, _ = print_and_read(*hole(5, 6, -1, -4, -7, -10))
    assert lines[1] == "G98 G83 X5 Y6 Z-10 R2 Q3.000001 F300"


def test_a_rounded_depth_has_no_last_peck_of_the_rounding():
    lines, _, _ = print_and_read(*hole(5, 6, -1.7419208, -3.4838208, near=0.0))
    assert lines[1] == "G98 G83 X5 Y6 Z-3.484 R0 Q1.742001 F300"


def test_pecks_whose_last_one_is_lost_by_rounding_are_not_a_cycle():
    lines, _, _ = print_and_read(*hole(5, 6, -1, -4, -7, -7.0004))
    assert not any("G83" in line for line in lines)


@pytest.mark.parametrize(
    "body",
    [
        hole(5, 6, -0.5, -1, -1.5),
        hole(5, 6, -1.6, between=(Output("process", 1.0),)),
        hole(5, 6, -1.6, between=(Wait(0.5),)),
        hole(5, 6, -1.6, feed=100.0),
        [*hole(5, 6, -1, -4, -7)[:-1], MoveL(at(5, 6, 20), 5.0)],
        [*hole(5, 6, -1.6)[:-2], MoveL(at(7, 6, -1.6), 5.0), MoveJ(at(7, 6, 20), 100.0)],
        [*hole(5, 6, -1.6)[:-1], MoveJ(at(5, 6, 25), 100.0)],
    ],
    ids=[
        "equal pecks",
        "signal",
        "wait",
        "feed of travel",
        "up at the feed",
        "a slot",
        "higher than before",
    ],
)
def test_motions_that_are_not_a_cycle_stay_as_they_are(body):
    _, ready, text = print_and_read(*body)
    assert "G8" not in text.replace("G80 G90", "")
    planned = {id(item) for item in body}
    assert [item for item in ready.body if id(item) in planned] == body
    assert kinds(ready.body) == kinds(program(*body).body)


def test_without_the_option_cycles_a_hole_is_motions():
    lines, _, _ = print_and_read(*hole(5, 6, -1.6), cycles=False)
    assert lines == ["G0 X5 Y6 Z20", "G0 Z2", "G1 Z0 F300", "G1 Z-1.6", "G1 Z0 F6000", "G0 Z20"]


def make_holes(chosen) -> list[Instruction]:
    """Holes of several kinds, some of them at one position, and slots between them."""
    body: list[Instruction] = []
    for kind, x, y, depth, count, near, peck in chosen:
        if kind == "slot":
            body += [
                MoveJ(at(x, y, 20), 100.0),
                MoveL(at(x, y, -depth), 5.0),
                MoveL(at(x + 1, y, -depth), 5.0),
            ]
            body.append(MoveJ(at(x + 1, y, 20), 100.0))
            continue
        step = max(peck, near + 0.3)
        levels = [near - step * k for k in range(1, count)] if kind == "pecked" else []
        body += hole(x, y, *levels, (levels[-1] if levels else 0) - depth, near=near)
    # As in `camgen.lower`, a second hole at one position starts where the first one ends.
    position = None
    moving = []
    for item in body:
        target = None if isinstance(item, Comment) else item.target.origin
        if target is None or target != position:
            moving.append(item)
        position = target or position
    return moving


HOLES_AND_SLOTS = st.tuples(
    st.sampled_from(["plain", "plain", "pecked", "slot"]),
    st.sampled_from([1.0, 2.5, 7.12345]),
    st.sampled_from([0.0, 3.3333]),
    st.floats(0.01, 3).map(lambda v: round(v, 4)),
    st.integers(2, 5),
    st.sampled_from([0.0, 1.0, 2.0]),
    st.floats(0.5, 4),
)


@needs_rs274
@given(st.lists(HOLES_AND_SLOTS, min_size=1, max_size=8))
# The printed Z is 0.00016 mm deeper than two pecks, and there must not be a third peck.
@example([("pecked", 1.0, 0.0, 1.7419, 2, 0.0, 1.7419208485678386)])
def test_linuxcnc_drills_as_planned(chosen):
    ready, text = posted(gcode(), program(*make_holes(chosen)))
    canon = run(text)
    assert not canon.error
    # LinuxCNC begins a cycle with a motion to its current position.
    calls = list(canon.calls[:2])
    for before, call in pairwise(canon.calls[1:]):
        if call.end != before.end or "STRAIGHT" not in call.kind:
            calls.append(call)
    assert_moves(ready, replace(canon, calls=tuple(calls)))
    assert not difference(ready, read(text), gcode().tolerance())


KINDS = st.sampled_from(["plain", "pecked"])
HOLES = st.tuples(
    KINDS,
    st.just(1.0),
    st.just(2.0),
    st.just(1.5),
    st.integers(2, 4),
    st.just(2.0),
    st.floats(0.5, 4),
)


@given(st.lists(HOLES, min_size=1, max_size=4))
def test_a_cycle_changes_neither_the_depths_nor_the_length_at_the_feed(chosen):
    before, (after, _) = program(*make_holes(chosen)), posted(gcode(), program(*make_holes(chosen)))
    assert measure_drilling(before) == pytest.approx(measure_drilling(after))


def measure_drilling(plan) -> list[float]:
    """The heights at which the motion reverses, and the length that is cut at the feed, mm."""
    moves = [m for m in plan.body if isinstance(m, (MoveJ, MoveL, MoveC))]
    z = [m.target.origin[2] for m in moves]
    turns = [b for a, b, c in zip(z, z[1:], z[2:], strict=False) if (b - a) * (c - b) < 0]
    strokes = [(a, b) for a, b in pairwise(moves) if b.speed < 100]
    return [*turns, sum(abs(b.target.origin[2] - a.target.origin[2]) for a, b in strokes)]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("G98 G81 X1 Y1 Z-1 F100", "G81 without R"),
        ("G98 G83 X1 Y1 Z-1 R1 F100", "G83 without Q"),
        ("G98 G83 X1 Y1 Z-1 R1 Q0 F100", "G83 with pecks of Q0"),
        ("G98 G81 X1 Y1 Z2 R1 F100", "begins (R) below its end"),
        ("G98 G81 X1 Y1 Z-1 R1", "G81 without a feed"),
        ("G98 G81 F100", "G81 without X, Y or Z"),
    ],
)
def test_a_wrong_cycle_is_a_fault(line, message):
    text = "\n".join(["G21 G49 G64 P0.01 Q0", "G0 Z5", "G0 X0 Y0", line, "G80", "M2", ""])
    assert any(message in fault.what for fault in read(text).findings)


@pytest.mark.parametrize(
    "line", ["G99 G81 X1 Y1 Z-1 R1 F100", "G98 G81 X1 Y1 Z-1 R1 L2 F100", "G98 G81 X1 Z-1 R9 F100"]
)
def test_a_cycle_that_no_post_writes_is_read_with_a_remark(line):
    text = "\n".join(["G17 G21 G90 G64 P0.01 Q0", "G0 Z5", "G0 X0 Y0", line, "G80", "M2", ""])
    reading = read(text)
    assert any("does not write" in finding.what for finding in reading.findings)
    assert len(reading.body) >= 4


def test_a_wait_at_the_bottom_is_read():
    lead = [
        "G17 G21 G40 G54 G80 G90 G91.1 G94 G64 P0.01 Q0",
        "G53 G0 Z0",
        "G49",
        "G0 X0 Y0",
        "G0 Z5",
    ]
    reading = read("\n".join([*lead, "G98 G82 X1 Y1 Z-1 R1 P0.5 F60", "G80", "M2", ""]))
    assert not reading.findings
    assert kinds(reading.body) == [MoveJ, MoveJ, MoveJ, MoveL, Wait, MoveJ]
    assert reading.body[4].seconds == 0.5
