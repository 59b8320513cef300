"""Nearly valid settings and plans: jobs, cells, URDF, plan files, cameras."""

from __future__ import annotations

import json
from functools import cache

from hypothesis import strategies as st

from bench.reliability.fuzzing.odd import as_bytes, edited, names, numbers, rarely

# Jobs: every setting with values that it may have, and some that it may not.

_TEXTS = (
    '"auto"', '"mm"', '"inch"', '"A4"', '"A3 landscape"', '"*"', '""', '"convex"', '"IRB 120"', '"process"',
    '"x.urdf"', '"7x5"', '"fit"', '"not e1"', '"../x"',
)  # fmt: skip
_OTHER = (
    "true", "false", "[]", "[1, 2, 3]", "[1, 2, 3, 4, 5, 6]", "[[0, 0], [9, 0], [9, 9], [0, 9]]", '["*", "!x"]', "{}",
    '{process = "doX"}', "{a = {b = 1}}", "1979-05-27T07:32:00Z", "07:32:00", "[[1, 2, 3, 4, 5, 6]]", '["x.stl"]',
    "[nan]", "[1e308, 0, 0, 0, 0, 0]", "0x1F", "0b1", '"""a\nb"""', "[[[[]]]]", '[1, "a"]',
)  # fmt: skip
_POST_KEYS = (
    "program", "decimals", "max_lines", "signals", "spindle", "force", "speed", "rated", "mps", "define", "work",
    "tool", "declare", "posture", "mass", "cog", "force_calibrated", "cycles", "power", "units", "zones",
)  # fmt: skip


@cache
def _keys() -> tuple[tuple[str, str], ...]:
    from camgen.model.job_tables import list_settings  # noqa: PLC0415 (of what is tried)

    return (
        *((one.table, one.key) for one in list_settings()),
        *(("post", key) for key in _POST_KEYS),
    )


@cache
def _allowed() -> dict[tuple[str, str], tuple[str, ...]]:
    """Values of each setting: its default and the words that it takes."""
    from camgen.model.job_tables import list_settings  # noqa: PLC0415

    found = {}
    for one in list_settings():
        words = (
            one.allowed.removeprefix("one of ").split(", ")
            if one.allowed.startswith("one of")
            else []
        )
        default = [] if one.default is None else [json.dumps(one.default)]
        found[one.table, one.key] = (*default, *words)
    return found


@st.composite
def _value(draw: st.DrawFn, key: tuple[str, str]) -> str:
    sound = _allowed().get(key, ())
    kind = draw(st.integers(0, 9))
    if sound and kind < 4:
        return draw(st.sampled_from(sound))
    if kind < 8:
        return draw(numbers)
    return draw(st.sampled_from(_TEXTS + _OTHER))


def _pick() -> st.SearchStrategy[tuple[str, str]]:
    return st.deferred(lambda: st.sampled_from(_keys()))


@st.composite
def job(draw: st.DrawFn) -> bytes:
    """A job file of a few settings, at times with a table twice, a key out of its table or a line that is no TOML."""
    tables: dict[str, list[str]] = {}
    for table, key in draw(st.lists(_pick(), min_size=1, max_size=5, unique=True)):
        home = draw(st.sampled_from(sorted({one for one, _ in _keys()}))) if draw(rarely) else table
        name = draw(names) if draw(rarely) and draw(rarely) else key
        tables.setdefault(home, []).append(f"{name} = {draw(_value((table, key)))}")
    lines = [line for table, rows in tables.items() for line in (f"[{table}]", *rows)]
    if draw(rarely):
        junk = (
            "[x]",
            "[[cell]]",
            "a",
            "[cell",
            "= 1",
            "a.b.c = 1",
            "[post.signals]",
            "x = 1",
            "# \x7f",
            "[a.b]",
        )
        lines.insert(draw(st.integers(0, len(lines))), draw(st.sampled_from(junk)))
    return as_bytes("\n".join(lines))


@st.composite
def cell(draw: st.DrawFn) -> bytes:
    """The file of a cell."""
    keys = [key for key in _keys() if key[0] == "cell"]
    rows = [
        f"{key[1]} = {draw(_frame() | _value(key))}"
        for key in draw(st.lists(st.sampled_from(keys), max_size=4, unique=True))
    ]
    return as_bytes("\n".join([draw(st.sampled_from(("[cell]",) * 7 + ("", "[tool]"))), *rows]))


def _frame() -> st.SearchStrategy[str]:
    return st.lists(numbers, min_size=5, max_size=7).map(lambda row: f"[{', '.join(row)}]")


@st.composite
def assignment(draw: st.DrawFn) -> bytes:
    """What follows --set."""
    table, key = draw(_pick())
    name = draw(
        st.sampled_from(
            (f"{table}.{key}",) * 6
            + (table, key, f"{table}.x", f"x.{key}", "", ".", f"{table}.a.b")
        )
    )
    return as_bytes(f"{name}{'' if draw(rarely) else '='}{draw(_value((table, key)))}")


# URDF: a chain of links and joints.

_JOINT_TYPES = st.sampled_from(
    ("revolute",) * 5 + ("continuous", "prismatic", "fixed", "floating", "planar", "x", "")
)
_SHAPES = (
    '<box size="{} {} {}"/>', '<cylinder radius="{}" length="{}"/>', '<sphere radius="{}"/>', '<mesh filename="{}"/>',
    "<capsule/>", "",
)  # fmt: skip
_AXES = st.sampled_from(
    ("0 0 1", "0 1 0", "1 0 0", "0 1 0", "0 -1 0", "0 0 0", "1 1 1", "1 2", "1e-9 0 0", "nan 0 1")
)
_RIGHT = st.sampled_from(("0 0 0", "1.5708 0 0", "0 1.57 0", "0 0 -1.5708", "0 0 0.3"))


@st.composite
def _origin(draw: st.DrawFn) -> str:
    if draw(rarely):
        return ""
    xyz = (
        " ".join(draw(numbers) for _ in range(3))
        if draw(rarely)
        else draw(st.sampled_from(("0 0 0.3", "0.2 0 0")))
    )
    rpy = " ".join(draw(numbers) for _ in range(3)) if draw(rarely) else draw(_RIGHT)
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'


@st.composite
def _link(draw: st.DrawFn, name: str) -> str:
    shape = draw(st.sampled_from(_SHAPES))
    shape = shape.format(*(draw(numbers) for _ in range(shape.count("{}"))))
    tag = draw(st.sampled_from(("collision", "collision", "visual")))
    body = (
        f"<{tag}>{draw(_origin())}<geometry>{shape}</geometry></{tag}>"
        if draw(st.booleans())
        else ""
    )
    return f'<link name="{name}">{body}</link>'


@st.composite
def _joint(draw: st.DrawFn, k: int) -> str:
    low, high = (draw(numbers), draw(numbers)) if draw(rarely) else ("-2.5", "2.5")
    limit = f'<limit lower="{low}" upper="{high}" velocity="{draw(numbers) if draw(rarely) else 2}" effort="1"/>'
    other = draw(st.integers(0, 7)) if draw(rarely) else k + 1
    mimic = f'<mimic joint="j{other}" multiplier="{draw(numbers)}"/>' if draw(rarely) else ""
    limit = "" if draw(rarely) else limit
    ends = f'<parent link="l{k}"/><child link="l{other}"/>'
    axis = f'<axis xyz="{draw(_AXES) if draw(rarely) else "0 1 0"}"/>'
    kind = draw(_JOINT_TYPES) if draw(rarely) else "revolute"
    return f'<joint name="j{k}" type="{kind}">{draw(_origin())}{ends}{axis}{limit}{mimic}</joint>'


@st.composite
def urdf(draw: st.DrawFn) -> bytes:
    """An arm of up to seven joints."""
    count = draw(st.integers(0, 7))
    parts = [draw(_link(f"l{k}")) for k in range(count + 1)] + [
        draw(_joint(k)) for k in range(count)
    ]
    if draw(rarely):
        at = draw(st.integers(0, len(parts) - 1))
        parts[at : at + 1] = draw(
            st.sampled_from(([], [parts[at]] * 2, ["<link/>"], ["<joint/>"], ["text"]))
        )
    return f'<robot name="{draw(st.sampled_from(("arm", "arm", "", "x" * 600)))}">{"".join(parts)}</robot>'.encode()


# Plan files and cameras: sound ones with changes.


@cache
def _plans() -> tuple[str, ...]:
    from bench.reliability.programs import SOURCES, make  # noqa: PLC0415
    from camgen.cli.motion_file import encode  # noqa: PLC0415

    made = [make(post, k) for post in SOURCES for k in (1, 3, 5)]
    return tuple(encode(one.prepared, one.post.name, one.options, 0.01).decode() for one in made)


_PLAN_WORDS = (
    "null", "true", "[]", "{}", '"x"', "movel", "movec", "movej", "output", "wait", "force", "comment", "joints",
    "blend", "path", "work", "turn", "share", "press", "posture", "called", "rapid", "-1", "1e20",
)  # fmt: skip


def plan() -> st.SearchStrategy[bytes]:
    """A plan file with changes."""
    return st.deferred(lambda: edited(_plans(), _PLAN_WORDS)).map(as_bytes)


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
    "rational_polynomial", "equidistant", "thin_prism", "rows", "cols", "data", "dt", "f", "u", "3c", "!!opencv-matrix",
    "null", "{", "[", "&a", "*a", "- ", ": ", "!!python/object", "|", ">", "roi", "binning_x",
)  # fmt: skip


def camera() -> st.SearchStrategy[bytes]:
    """A calibration with changes."""
    return edited(_CAMERAS, _CAMERA_WORDS).map(as_bytes)
