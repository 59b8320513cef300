"""Nearly valid settings and plans: jobs, cells, URDF, plan files, cameras."""

from __future__ import annotations

import json
from functools import cache

from hypothesis import strategies as st

from bench.reliability.fuzzing.odd import change_file, encode, names, numbers, rarely, split_words
from bench.reliability.programs import SOURCES, make
from camgen.cli import motion_file
from camgen.model.job_tables import list_settings

# Jobs: settings with values that they may have, and others.

_OTHER = (
    *('"auto"', '"mm"', '"inch"', '"A4"', '"A3 landscape"', '"*"', '""', '"convex"', '"IRB 120"'),
    *('"process"', '"x.urdf"', '"7x5"', '"fit"', '"not e1"', '"../x"', "true", "false", "[]"),
    *("[1, 2, 3]", "[1, 2, 3, 4, 5, 6]", "[[0, 0], [9, 0], [9, 9], [0, 9]]", '["*", "!x"]', "{}"),
    *('{process = "doX"}', "{a = {b = 1}}", "1979-05-27T07:32:00Z", "07:32:00", '["x.stl"]'),
    *("[[1, 2, 3, 4, 5, 6]]", "[nan]", "[1e308, 0, 0, 0, 0, 0]", "0x1F", "0b1", '"""a\nb"""'),
    *("[[[[]]]]", '[1, "a"]'),
)
_POST_KEYS = split_words("""
    program decimals max_lines signals spindle force speed rated mps define work tool declare
    posture mass cog force_calibrated cycles power units zones""")
#: Lines that are not TOML, or that belong to no table of a job.
_LINES = (
    *("[x]", "[[cell]]", "a", "[cell", "= 1", "a.b.c = 1", "[post.signals]", "x = 1", "# \x7f"),
    "[a.b]",
)
_Key = tuple[str, str]


def _list_allowed() -> dict[_Key, tuple[str, ...]]:
    """Values of each setting: its default and the words that it takes."""
    allowed: dict[_Key, tuple[str, ...]] = {}
    for setting in list_settings():
        values = []
        if setting.allowed.startswith("one of "):
            values = setting.allowed.removeprefix("one of ").split(", ")
        if setting.default is not None:
            values.insert(0, json.dumps(setting.default))
        allowed[setting.table, setting.key] = tuple(values)
    return allowed | {("post", key): () for key in _POST_KEYS}


_ALLOWED = _list_allowed()
_KEYS = st.sampled_from(tuple(_ALLOWED))
_TABLES = st.sampled_from(sorted({table for table, _ in _ALLOWED}))


@st.composite
def _value(draw: st.DrawFn, key: _Key) -> str:
    allowed = _ALLOWED[key]
    kind = draw(st.integers(0, 9))
    if allowed and kind < 4:
        return draw(st.sampled_from(allowed))
    if kind < 8:
        return draw(numbers)
    return draw(st.sampled_from(_OTHER))


@st.composite
def job(draw: st.DrawFn) -> bytes:
    """A job file of a few settings, at times with a key of another table or a line of no table."""
    tables: dict[str, list[str]] = {}
    for table, key in draw(st.lists(_KEYS, min_size=1, max_size=5, unique=True)):
        chosen = draw(_TABLES) if draw(rarely) else table
        name = draw(names) if draw(rarely) and draw(rarely) else key
        tables.setdefault(chosen, []).append(f"{name} = {draw(_value((table, key)))}")
    lines = []
    for table, rows in tables.items():
        lines += [f"[{table}]", *rows]
    if draw(rarely):
        lines.insert(draw(st.integers(0, len(lines))), draw(st.sampled_from(_LINES)))
    return encode("\n".join(lines))


_FRAME = st.lists(numbers, min_size=5, max_size=7).map(lambda row: f"[{', '.join(row)}]")


@st.composite
def cell(draw: st.DrawFn) -> bytes:
    """The file of a cell."""
    keys = [key for key in _ALLOWED if key[0] == "cell"]
    lines = [draw(st.sampled_from(("[cell]",) * 7 + ("", "[tool]")))]
    for key in draw(st.lists(st.sampled_from(keys), max_size=4, unique=True)):
        lines.append(f"{key[1]} = {draw(_FRAME | _value(key))}")
    return encode("\n".join(lines))


@st.composite
def assignment(draw: st.DrawFn) -> bytes:
    """The argument of --set."""
    table, key = draw(_KEYS)
    others = (table, key, f"{table}.x", f"x.{key}", "", ".", f"{table}.a.b")
    name = draw(st.sampled_from((f"{table}.{key}",) * 6 + others))
    return encode(f"{name}{'' if draw(rarely) else '='}{draw(_value((table, key)))}")


# URDF, plan files and cameras: sound ones with changes.

_SHAPES = (
    '<box size="0.1 0.2 0.3"/>',
    '<cylinder radius="0.1" length="0.4"/>',
    '<sphere radius="0.1"/>',
)


def _make_urdf(count: int) -> str:
    """An arm with a number of joints, a line for each link and joint."""
    lines = ['<robot name="arm">']
    for number in range(count + 1):
        shape = _SHAPES[number % len(_SHAPES)]
        origin = '<origin xyz="0 0 0.1" rpy="0 0 0"/>'
        body = f"<collision>{origin}<geometry>{shape}</geometry></collision>"
        lines.append(f'<link name="l{number}">{body}</link>')
    for number in range(count):
        ends = f'<parent link="l{number}"/><child link="l{number + 1}"/>'
        axis = f'<axis xyz="0 {number % 2} {1 - number % 2}"/>'
        limit = '<limit lower="-2.5" upper="2.5" velocity="2" effort="1"/>'
        origin = f'<origin xyz="0.2 0 0.3" rpy="0 {1.5708 * (number % 2):g} 0"/>'
        joint = f"{origin}{ends}{axis}{limit}</joint>"
        lines.append(f'<joint name="j{number}" type="revolute">{joint}')
    return "\n".join([*lines, "</robot>"])


_URDF_WORDS = (
    *split_words(
        "revolute continuous prismatic fixed floating planar link joint child parent l0 l3"
    ),
    *('"0 0 0"', '"1 1 1"', '"1 2"', '"1e-9 0 0"', '"nan 0 1"', "<link/>", "<joint/>", "visual"),
    *('<mimic joint="j1" multiplier="2"/>', '<mimic joint="j9"/>', "x" * 600, "0.001"),
    *('<mesh filename="x.stl"/>', "<capsule/>"),
)


def urdf() -> st.SearchStrategy[bytes]:
    """An arm of up to seven joints."""
    return change_file([_make_urdf(count) for count in (0, 1, 6, 6, 7)], _URDF_WORDS, 2)


@cache
def _encode_plans() -> tuple[str, ...]:
    plans = []
    for post in SOURCES:
        for number in (1, 3, 5):
            program = make(post, number)
            plan = motion_file.encode(program.prepared, program.post.name, program.options, 0.01)
            plans.append(plan.decode())
    return tuple(plans)


_PLAN_WORDS = (
    *split_words(
        'null true [] {} "x" movel movec movej output wait force comment joints blend path'
    ),
    *split_words("work turn share press posture called rapid -1 1e20"),
)


def plan() -> st.SearchStrategy[bytes]:
    """A plan file with changes."""
    return st.deferred(lambda: change_file(_encode_plans(), _PLAN_WORDS))


_CAMERAS = (
    """image_width: 640
image_height: 480
camera_name: cam
camera_matrix:
  rows: 3
  cols: 3
  data: [600.0, 0.0, 320.0, 0.0, 600.0, 240.0, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.1, 0.01, 0.0, 0.0, 0.0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
projection_matrix:
  rows: 3
  cols: 4
  data: [600.0, 0.0, 320.0, 0.0, 0.0, 600.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
""",
    """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 600., 0., 320., 0., 600., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.1, 0.01, 0., 0., 0. ]
""",
)
_CAMERA_WORDS = (
    *split_words(
        "rational_polynomial equidistant thin_prism rows cols data dt f u 3c null { [ &a *a"
    ),
    *split_words("!!opencv-matrix !!python/object | > roi binning_x"),
    *("- ", ": "),
)


def camera() -> st.SearchStrategy[bytes]:
    """A calibration with changes."""
    return change_file(_CAMERAS, _CAMERA_WORDS)
