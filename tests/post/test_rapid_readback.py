"""RAPID: the fast path of the read-back and the general parser read the same."""

import random
import re
from collections.abc import Mapping
from itertools import chain

import pytest
from camgen_posts.rapid import Rapid
from hypothesis import given
from hypothesis import strategies as st

import camgen.lang.rapid.strict as readback
from camgen.lang.log import Log
from camgen.lang.programs import Executed
from camgen.lang.rapid.rows import Rows, Spellings, read_positions
from camgen.lang.rapid.strict import read, read_with
from camgen.lang.rapid.strict.syntax import Written, calls_of, parse
from camgen.lang.rapid.tree import Calling, Inline, Routine, Run
from camgen.model.pose import translation
from camgen.model.program import (
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Origin,
    Output,
    Program,
    switch_off_first,
)
from camgen.post.plugins import make_post
from tests.support.examples import is_night
from tests.support.fast_paths import list_values
from tests.support.rapid_programs import at
from tests.support.rapid_texts import E9, POINT, START, TAIL, TOOL, WORK, changed, program
from tests.support.whole import whole


def read_both(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """Reads a program with and without the fast path, compares the readings, and returns one."""
    reading = read(files, options)
    general = read_with(files, options, plain=False)
    assert list_values(reading, False) == list_values(general, False)
    return reading


#: The tool and the work object of `module`.
NAMES: dict[str, object] = {"tool": "t1", "work": "w1"}


def module(body: str, data: str = "") -> str:
    """A module whose main starts to move in line 5, and whose statements begin in line 6."""
    frames = TOOL.format("t1", 9) + WORK.format("w1", 100)
    return f"MODULE m\n{frames}{data}PROC main()\n{START}{body}ENDPROC\nENDMODULE\n"


def kinds(text: str) -> list[tuple[str, str]]:
    """Whether the fast path took each statement of a text, and its name."""
    calls: list[Calling | Inline] = []
    for routine in list_routines(text):
        calls += calls_of(routine.body)
    return [("inline", c.shape.name) if isinstance(c, Inline) else ("call", c.name) for c in calls]


def list_routines(text: str) -> list[Routine]:
    modules = parse(text, 1, Spellings(Written), Log())
    return list(chain.from_iterable(module.routines for module in modules))


# Statements of the fast path


def posted(*body: Instruction, **options: object) -> str:
    home = MoveJ(Joints((0.0, 0.0, 0.0, 0.0, 0.5, 0.0)), 200.0)
    post = make_post(Rapid, {"force_calibrated": True} | options)
    prepared = post.prepare(
        Program("part", translation(3, 4, 5), translation(0, 0, 9), whole((home, *body))), 0.01
    )
    return post.render(prepared)[0].text


def test_the_fast_path_takes_every_motion_that_the_post_writes_with_points() -> None:
    """The arc of 87 deg is short enough not to be halved."""
    down = (0.0, 0.0, -1.0)
    text = posted(
        MoveJ(at(0, 0, 5), 50.0),
        MoveL(at(0, 0), 20.0),
        Output("process", 1),
        MoveC(at(5, 2), at(10, 0), 7.5, 1.0),
        MoveL(at(20, 0), 20.0),
        Force(9.0, down),
        MoveL(at(30, 0), 20.0, 0.0, 9.0, down),
        MoveL(at(40, 0), 20.0, 0.0, 9.0, down),
        MoveC(at(45, 2), at(50, 0), 20.0, 0.0, 9.0, down),
        Force(0.0),
        MoveL(at(50, 0, 9), 20.0),
        force_arcs=True,
    )
    assert kinds(text) == [
        *(("call", name) for name in ("confj", "confl", "setdo", "if fcdeact", "moveabsj")),
        ("inline", "movej"),
        ("inline", "movel"),
        ("call", "setdo"),
        ("inline", "movec"),
        ("inline", "movel"),
        *(("inline", name) for name in ("fcpress1lstart", "fcpressl", "fcpressc", "fcpressend")),
        ("call", "setdo"),  # at the end of main
        ("call", "setdo"),  # of camSafe
    ]
    assert read_both({"part.mod": text}, {}).findings == ()


def test_the_numbers_of_a_motion_are_read_at_their_places() -> None:
    turned = "[0.6,0,-.8,0],[0,-1,0,0]"
    text = module(
        f"MoveL [[-1.25,.5,3.],[0,1,0,0],[0,0,0,0],{E9}],v100,z5,{TAIL}"
        f"MoveC [[4,5,6],[0,0,1,0],[0,-1,0,0],{E9}],\n  [[7,8,-0.001],{turned},{E9}],v5,fine,{TAIL}"
        f"MoveL [[-9,.5,3.],[0.6,0,-.8,0],[0,0,0,0],{E9}],v100,z5,{TAIL}"
        f"! a remark; [[1,2,3]\n\nMoveC [[1,5,7],[0,0,1,0],[0,-1,0,0],{E9}],\n"
        f"  [[8,8,8],{turned},{E9}],v5,fine,{TAIL}"
    )
    reading = read_both({"m.mod": text}, NAMES)
    assert reading.findings == ()
    assert tuple(reading.lines) == (5, 6, 7, 9, 12)
    line, arc, again, last = reading.body[1:]
    assert isinstance(line, MoveL)
    assert isinstance(arc, MoveC)
    assert isinstance(again, MoveL)
    assert isinstance(last, MoveC)
    assert (line.target.origin, line.speed, line.blend) == ((-1.25, 0.5, 3.0), 100.0, 5.0)
    assert (arc.via.origin, arc.target.origin, arc.speed, arc.blend) == (
        (4, 5, 6),
        (7, 8, -0.001),
        5.0,
        0.0,
    )
    assert (again.target.origin, again.speed, again.blend) == ((-9, 0.5, 3), 100.0, 5.0)
    assert (last.via.origin, last.target.origin) == ((1, 5, 7), (8, 8, 8))
    # q = (0.6, 0, -0.8, 0) is a rotation about -y by 2 acos(0.6), whose cosine is 0.36 - 0.64
    # and whose sine is 2 * 0.6 * 0.8.
    assert last.target.rotation.ravel().tolist() == pytest.approx(
        [-0.28, 0, -0.96, 0, 1, 0, 0.96, 0, -0.28]
    )
    assert last.via.rotation.tolist() == [[-1, 0, 0], [0, 1, 0], [0, 0, -1]]


def test_equal_statements_use_the_data_of_their_scope() -> None:
    move = f"MoveL {POINT},vOwn,zOwn,{TAIL}"
    data = (
        "LOCAL CONST speeddata vOwn:=[{},500,5000,1000];\n"
        "LOCAL CONST zonedata zOwn:=[FALSE,{},1,1,1,1,1];\n"
    )
    files = {
        "a.mod": module(
            f"{move}{move}sub;\n{move}other;\nMoveL {POINT},v5,fine,{TAIL}", data.format(11, 2)
        ),
        "b.mod": f"MODULE b\n{data.format(22, 3)}PROC sub()\n"
        f"CONST speeddata vOwn:=[33,500,5000,1000];\n{move}ENDPROC\n"
        f"PROC other()\n{move}ENDPROC\nENDMODULE\n",
    }
    reading = read_both(files, NAMES)
    assert reading.findings == ()
    moves = [item for item in reading.body if isinstance(item, MoveL)]
    assert [(m.speed, m.blend) for m in moves] == [
        (11, 2),
        (11, 2),
        (33, 3),
        (11, 2),
        (22, 3),
        (5, 0),
    ]


def test_an_arc_may_have_a_point_by_name() -> None:
    arc = f"MoveC [[{{}},5,1],[0,1,0,0],[0,0,0,0],{E9}],p1,v5,fine,{TAIL}"
    text = module("".join(arc.format(x) for x in (4, 5, 6)), f"CONST robtarget p1:={POINT};\n")
    arcs = read_both({"m.mod": text}, NAMES).body[1:]
    assert [item.via.origin for item in arcs if isinstance(item, MoveC)] == [
        (4, 5, 1),
        (5, 5, 1),
        (6, 5, 1),
    ]
    assert [item.target.origin for item in arcs if isinstance(item, MoveC)] == [(1, 2, 3)] * 3


#: A quaternion with a number that is larger than a num can be.
NINES = f"0,{'9' * 50},0,0]"

# Statements of the general parser


@pytest.mark.parametrize(
    ("body", "faults"),
    [
        (
            (
                f"MoveC [[1E1,2,3],[0,1,0,0],[0,0,0,0],{E9}],"
                f"[[4,5,7],[0,1,0,0],[0,0,0,0],{E9}],v5,fine,{TAIL}"
            ),
            [],
        ),
        (
            f"MoveL {POINT},v5,fine,{TAIL}%%%\nVERSION:1\n%%%\nMoveL {POINT},v5,fine,{TAIL}",
            [(7, "a statement expected, found '%'")],
        ),
        (
            f'MoveL {POINT},v5,fine,{TAIL}TPWrite "a;MoveL {POINT[:9]},v5,fine,{TAIL[:-1]}";\n',
            [(7, "a backslash in a string is written twice, or before two hexadecimal digits")],
        ),
        ('TPWrite "a;b";\n', [(6, "tpwrite is a statement that is not read")]),
        (f"MoveL {POINT},v5,fine,t1 ! ; \\WObj:=w1;\n\\WObj:=w1;\n", []),
        (
            f"MoveL Offs(p1,1,\n2),v5,fine,{TAIL}" * 2,
            [(6, "offs has 4 arguments, not 3"), (8, "offs has 4 arguments, not 3")],
        ),
        (
            f"MoveL {POINT},v5,fine,{TAIL}" * 2 + f"MoveL {POINT},v5,fine,t2\\WObj:=w1;\n" * 2,
            [(8, "t2 is not declared"), (9, "t2 is not declared")],
        ),
        (
            (
                f"MoveL {POINT},v5,fine,{TAIL}"
                f"MoveL {POINT.replace('0,1,0,0]', '0,1,.1,0]', 1)},v5,fine,{TAIL}"
            ),
            [(7, "a quaternion is not normalised (its square differs from 1 by 0.01)")],
        ),
        (
            (
                f"MoveL {POINT},v5,fine,{TAIL}"
                f"MoveL {POINT.replace('0,1,0,0]', NINES, 1)},v5,fine,{TAIL}"
            ),
            [(7, "a number of a robtarget is larger than a num can be")],
        ),
        (
            f"MoveL {POINT},v5,fine,{TAIL}MoveL {POINT.replace('1,2,3', '1,2,3,4')},v5,fine,{TAIL}",
            [(7, "pos has 3 components, not 4")],
        ),
        (
            f"MoveL {POINT},v5,fine,{TAIL}MoveL {POINT.replace('1,2,3', '1,2-,3')},v5,fine,{TAIL}",
            [(7, "] expected, found '-'")],
        ),
        (
            f"MoveL {POINT},v5,fine,{TAIL}MoveL {POINT.replace('1,2,3', '1,2_0,3')},v5,fine,{TAIL}",
            [(7, "] expected, found '_'")],
        ),
        (
            f"MoveC {POINT},{POINT},v5,fine,{TAIL}" * 3,
            [
                (7, "the points of an arc are on one line"),
                (8, "the points of an arc are on one line"),
            ],
        ),
        (
            f"FCPressL {POINT},v5,9,fine,{TAIL}" * 2,
            [(6, "fcpressl without FCPress1LStart"), (7, "fcpressl without FCPress1LStart")],
        ),
        (
            f"MoveL {POINT},v5,fine,{TAIL}FCPress1LStart {POINT},v5,\\Fx:=5,50,fine,{TAIL}"
            + (
                f"FCPressL {POINT},v5,5,fine,{TAIL}FCPressL {POINT},v5,-5,fine,{TAIL}"
                f"MoveL {POINT},v5,fine,{TAIL}"
            )
            + f"FCPressEnd {POINT},v5,{TAIL}FCPressEnd {POINT},v5,{TAIL}",
            [
                (9, "fcpressl does not press in the direction of FCPress1LStart"),
                (10, "movel while pressing, before FCPressEnd"),
                (12, "fcpressend without FCPress1LStart"),
            ],
        ),
        (
            f"SetDO do1,1;SetDO do1,1;SetDO {POINT},1;\nsub {POINT};\n",
            [(6, "setdo needs the name of a signal"), (7, "sub is a statement that is not read")],
        ),
    ],
)
def test_an_unusual_statement_is_read_by_the_general_parser(
    body: str, faults: list[tuple[int, str]]
) -> None:
    reading = read_both({"m.mod": module(body)}, NAMES | {"on_error": "none"})
    assert [(fault.line, fault.what) for fault in reading.findings] == faults


@pytest.mark.parametrize(
    "text",
    [
        "ENDPROC",
        "IF a THEN b;",
        "CONST num n:=1;",
        ";",
        "SetDO do1,1",
        'TPWrite "a";',
        'TPWrite "a;',
        "x:=1;",
        "MoveL Offs(p1,0,0,1),v5,fine,t1;",
        "SetDO ! a remark\ndo1,1;",
        "! a remark",
        f"MoveL [ {POINT[1:]},v5,fine,t1",
        f"MoveL {POINT.replace('1,2', '1,2E0')},v5,fine,t1;",
        f"MoveC {POINT},{POINT},{POINT},v5,fine,t1;",
        f"SetDO do1,{POINT};",
    ],
)
def test_the_fast_path_ends_at_an_unusual_statement(text: str) -> None:
    """The fast path reads two outputs between two motions."""
    motion, outputs = f"MoveL {POINT},v5,fine,t1;", "\n  SetDO do1,1;\nSetDO do1,1;"

    def count_rows(between: str) -> int:
        statements = Rows(f"{motion}{between}{motion}", 7, Spellings(Written)).run(0)
        assert statements is not None
        return len(statements.run)

    assert count_rows(outputs) == 4
    assert count_rows(outputs + text) == 1


def test_a_routine_that_is_never_called_is_parsed_but_not_run() -> None:
    spare = (
        f"PROC spare()\nMoveL {POINT},v37,fine,{TAIL}"
        f"MoveL [[1,2,3],[{'9' * 40},0,0,0],[0,0,0,0],{E9}],v5,fine,{TAIL}"
    )
    text = module(f"MoveL {POINT},v5,fine,{TAIL}", f"{spare}ENDPROC\n")
    reading = read_both({"m.mod": text}, NAMES)
    assert len(reading.body) == 2
    assert [(f.line, f.what) for f in reading.findings] == [
        (4, "spare is declared and never used"),
        (6, "a number of a robtarget is larger than a num can be"),
    ]


POSITIONS = st.one_of(
    st.lists(st.decimals(-(10**7), 10**7, places=3).map(str), min_size=3, max_size=3).map(",".join),
    st.sampled_from(
        ["1,2,3", "-0.5,.5,3.", "1e2,2,3", "1,2", "1,2,3,4", "1, 2,3", "1,2_0,3", "007,0,0", ",,"]
    ),
    st.text("0123456789.,-", max_size=12),
)


@given(st.lists(POSITIONS, min_size=1, max_size=4))
def test_the_numbers_of_a_position_are_those_of_float(texts: list[str]) -> None:
    points, usual = read_positions(texts)
    for text, point, is_usual in zip(texts, points.tolist(), usual.tolist(), strict=True):
        if is_usual:
            assert point == [float(word) for word in text.split(",")]
        else:
            assert not re.fullmatch(r"-?\d{1,7}\.\d{3},-?\d{1,7}\.\d{3},-?\d{1,7}\.\d{3}", text)


# Random texts


@pytest.mark.parametrize("seed", range(30 if is_night() else 12))
def test_a_random_text_is_read_the_same(seed: int) -> None:
    chance = random.Random(seed)
    at_once = motions = 0
    for _ in range(20):
        texts = program(chance)
        for _ in range(chance.choice([0, 0, 1, 2, 4])):
            k = chance.randrange(len(texts))
            texts[k] = changed(chance, texts[k])
        options = chance.choice([{}, {}, {"declare": False}, {"s4": True}, {"force_sign": -1}])
        reading = read_both({f"{k}.mod": text for k, text in enumerate(texts)}, options)
        motions += len(reading.body)
        for text in texts:
            at_once += sum(how == "inline" for how, _ in kinds(text))
    assert motions > 50
    assert at_once > 50


# Runs of statements


#: The tool straight down, as the post prints it.
DOWN = "0.0000000,1.0000000,0.0000000,0.0000000"


def rows_of(text: str) -> list[int]:
    """The number of statements of each run of a text."""
    items = chain.from_iterable(routine.body for routine in list_routines(text))
    return [item.last - item.first for item in items if isinstance(item, Run)]


def plate(paths: int) -> str:
    """A printed program: on each path down, a line and an arc with the signal on, and up."""
    body: list[Instruction] = [MoveJ(Joints((0.0, 0.0, 0.0, 0.0, 0.5, 0.0)), 100.0)]
    for k in range(paths):
        x, up = 40.0 * k, MoveL(at(40.0 * k, 0.0, 20.0), 100.0, path=k)
        quarter = [
            MoveC(at(x + 3, 1.2, 0), at(x + 4, 4, 0), 12.0, 1.0, path=k),
            MoveL(at(x, 9.9, 0), 15.5, path=k),
        ]
        body += [
            up,
            MoveL(at(x, 0.0), 5.0, path=k),
            Output("process", 1.0),
            *quarter,
            Output("process", 0.0),
        ]
        body.append(MoveL(at(x, 9.9, 20.0), 100.0, 5.0 if k + 1 < paths else 0.0, path=k))
    post = make_post(Rapid, {"mass": 1.0})
    paths_of = tuple(Origin(f"c{k}") for k in range(paths))
    safe = switch_off_first(body)
    program = Program("plate", translation(0, 0, 0), translation(0, 0, 100), safe, paths=paths_of)
    return post.render(post.prepare(program, 0.01))[0].text


def test_each_routine_of_a_printed_program_is_one_run() -> None:
    text = plate(5)
    assert rows_of(text) == [7] * 5
    reading = read_both({"plate.mod": text}, {"mass": 1.0})
    assert (len(reading.body), reading.findings) == (2 + 7 * 5, ())


@pytest.mark.parametrize(
    ("old", "new", "faults"),
    [
        ("vCam15_5,fine", "vCam15_5,z1", ["a motion that blends before setdo"]),
        (
            "vCam15_5,fine",
            "vNone,fine",
            ["a motion that blends before setdo", "vNone is not declared"],
        ),
        (
            "4.000,4.000,0.000]",
            "44.000,4.000,0.000]",
            ["the circle point of an arc is at an end of it, or nearly on its chord"],
        ),
        ("3.000,1.200,0.000]", "2.000,2.000,0.000]", ["the points of an arc are on one line"]),
        ("SetDO doProcess,1;", "SetDO doProcess,2;", ["a digital output is 0 or 1"]),
        (
            f"[{DOWN}],[0,0,0,0]",
            f"[{DOWN.replace('1.0', '1.1')}],[0,0,0,0]",
            ["a quaternion is not normalised (its square differs from 1 by 0.21)"],
        ),
        (f"[{DOWN}],[0,0,0,0]", "[0.0000000,0.0000000,1.0000000,0.0000000],[0,0,0,0]", []),
        ("tCamgen\\WObj:=wCamgen;", "tCamgen;", ["wobj0 is a second work object"]),
        ("[0,0,0,0]", "[0,0,0,9]", ["cfx is 9, not 0 to 7"]),
        ("RAISE;", "EXIT;", None),
        ("    ERROR", "ERROR ! x\n    ", []),
        ("PROC c2()", "PROC  c2 ()", []),
        ("PROC c2()", "PROC c2()\n! path c2", []),
        ("        SetDO doProcess,0;", "! SetDO doProcess,0;", None),
        ("MoveL [[", "moveL [[", []),
        ("MoveC [[", "MoveL [[", ["movel has 4 arguments, not 5"]),
        ("        MoveL", "\n\n   MoveL", []),
        ("fine,tCamgen", "fine ,tCamgen", []),
        ("0.000]", "0.]", []),
        ("0.000],", "1E-3],", []),
        ("MoveL [[", "FCPressL [[", None),
        ("MoveL [[", "MoveJ [[", None),
        ("MoveL [[", "PROC [[", None),
        (" SetDO doProcess,1;", " SetDO doProcess,1;SetDO doProcess,1;", []),
        (" SetDO doProcess,1;", " WaitTime 1;", []),
        (" SetDO doProcess,1;", " c1;", None),
    ],
)
@pytest.mark.parametrize("occurrence", [0, 2, -1])
def test_a_changed_program_is_read_the_same(
    old: str, new: str, faults: list[str] | None, occurrence: int
) -> None:
    """The change is at the first, third or last occurrence after main."""
    text = plate(4)
    begin = text.index("PROC c0")
    matches = re.finditer(re.escape(old), text)
    places = [match.start() for match in matches if match.start() > begin]
    place = places[occurrence] if len(places) > 2 else places[-1]
    reading = read_both({"plate.mod": text[:place] + new + text[place + len(old) :]}, {"mass": 1.0})
    if faults is not None and occurrence == 2:
        assert [fault.what for fault in reading.findings if fault.level == "refused"] == faults


@pytest.mark.parametrize("seed", range(12))
def test_a_randomly_damaged_program_is_read_the_same(seed: int) -> None:
    chance = random.Random(seed)
    for _ in range(8):
        text = plate(chance.choice([1, 3]))
        for _ in range(chance.choice([1, 1, 3])):
            text = changed(chance, text)
        read_both({"plate.mod": text}, {"mass": 1.0})


def test_a_program_with_too_many_statements_is_a_fault_at_the_first_beyond_the_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(readback, "_MOST_STATEMENTS", 20)
    reading = read_both({"plate.mod": plate(4)}, {"mass": 1.0})
    assert [fault.what for fault in reading.findings][:1] == ["more than 20 statements are run"]
    assert len(reading.body) < 20
