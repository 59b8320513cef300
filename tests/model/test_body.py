"""A packed body has the instructions that it was packed from."""

from collections.abc import Sequence
from itertools import pairwise
from operator import itemgetter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.model import body as packed_body
from camgen.model.body import Body, BodyBuilder, Targets, join, make_plain_motions, merge, pack
from camgen.model.errors import Refused
from camgen.model.pose import IDENTITY, TOOL_DOWN, Pose
from camgen.model.program import (
    Columns,
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Posture,
    Program,
    ToolChange,
    Wait,
    splice,
    switch_off_first,
)

HERE = Pose(IDENTITY, (0.0, 0.0, 0.0))
#: Each kind of instruction, and motions with more than target, speed and blend.
ITEMS: tuple[Instruction, ...] = (
    Output("process", 0.0),
    Force(0.0),
    MoveJ(Joints((0.1, 0.2)), 100.0),
    Comment("path c1"),
    MoveJ(Pose(TOOL_DOWN, (1.0, 2.0, 3.0)), 50.0, 1.0, path=0),
    MoveJ(HERE, 50.0, share=0.5, rate=0.25),
    MoveL(Pose(TOOL_DOWN, (1.5, 2.5, -0.0)), 20.0, path=0, work=True),
    MoveL(HERE, 20.0, joints=Joints((1.0,)), posture=Posture(figure=3)),
    Output("process", 1.0),
    Wait(0.5),
    MoveC(
        Pose(IDENTITY, (1.0, 1.0, 0.0)),
        Pose(TOOL_DOWN, (2.0, 0.0, 0.0)),
        7.0,
        0.3,
        path=1,
        work=True,
    ),
    Force(10.0, (0.0, 0.0, -1.0)),
    MoveC(Pose(TOOL_DOWN, (3.0, 1.0, 0.0)), HERE, 7.0, 0.0, 10.0, (0.0, 0.0, -1.0), path=1),
    MoveL(Pose(TOOL_DOWN, (0.0, 0.0, 0.0)), 5.0, turn=0.2),
    Force(0.0),
    Output("process", 0.0),
    ToolChange(2, "drill"),
    MoveJ(Joints((0.1, 0.2)), 100.0),
)


def parts(item: Instruction) -> tuple[object, ...]:
    """All fields of an instruction. A rotation is compared as an object, as programs share them."""

    def field(value: object) -> object:
        return ("pose", id(value.rotation), value.origin) if isinstance(value, Pose) else value

    return type(item), *(field(getattr(item, name)) for name in item.__struct_fields__)


def same(body: object, other: object) -> bool:
    return list(map(parts, body)) == list(map(parts, other))  # type: ignore[call-overload]


def take_motions(items: Sequence[object]) -> list[object]:
    return [item for item in items if isinstance(item, (MoveJ, MoveL, MoveC))]


@pytest.fixture(params=[1, 2, 5, 8192])
def block(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The number of instructions that are packed at a time."""
    monkeypatch.setattr(packed_body, "_BLOCK", request.param)


@pytest.mark.usefixtures("block")
def test_a_packed_body_has_its_instructions() -> None:
    body = pack(ITEMS)
    assert len(body) == len(ITEMS)
    assert same(body, ITEMS)
    assert same([body[k] for k in range(len(ITEMS))], ITEMS)
    assert same([body[k] for k in range(-len(ITEMS), 0)], ITEMS)
    assert type(body[2]) is MoveJ
    with pytest.raises(IndexError):
        body[len(ITEMS)]


@pytest.mark.parametrize(
    "cut", [slice(0, 4), slice(3, None), slice(-5, -1), slice(4, 2), slice(None, None, 3)]
)
def test_a_slice_of_a_body_is_the_one_of_a_tuple(cut: slice) -> None:
    assert same(pack(ITEMS)[cut], ITEMS[cut])


@pytest.mark.usefixtures("block")
def test_a_plain_motion_is_not_kept_as_an_object_and_others_are() -> None:
    kept = pack(ITEMS).objects
    others = [item for k, item in enumerate(ITEMS) if k not in (4, 6, 10)]
    assert {id(item) for item in kept} == {id(item) for item in others}


@pytest.mark.usefixtures("block")
def test_a_builder_is_like_a_list() -> None:
    builder = BodyBuilder()
    for k, item in enumerate(ITEMS):
        assert len(builder) == k
        builder.append(item)
    builder.extend(ITEMS)
    assert same(builder, ITEMS * 2)
    builder.append(ITEMS[6])
    assert same(builder.body(), (*ITEMS, *ITEMS, ITEMS[6]))
    assert same(builder[-2:], (ITEMS[-1], ITEMS[6]))
    assert len(BodyBuilder().body()) == 0


def test_bodies_that_share_no_rotations_are_joined() -> None:
    other = (MoveJ(Pose(np.eye(3), (9.0, 9.0, 9.0)), 1.0), *ITEMS)
    assert same(join(pack(ITEMS), pack(other), pack(())), (*ITEMS, *other))


@pytest.mark.usefixtures("block")
def test_instructions_are_taken_from_a_body_in_any_order() -> None:
    wanted = np.array([10, 3, 3, 12, 0, 6, 17])
    assert same(pack(ITEMS).take(wanted), [ITEMS[k] for k in wanted.tolist()])
    increasing = np.unique(wanted)
    assert same(pack(ITEMS).pick(increasing), [ITEMS[k] for k in increasing.tolist()])


@pytest.mark.parametrize(
    "changed", [{}, {0: ()}, {6: (ITEMS[10], ITEMS[3]), 10: (), 17: (ITEMS[5],)}]
)
def test_a_packed_body_is_spliced_like_a_tuple(
    changed: dict[int, tuple[Instruction, ...]],
) -> None:
    assert same(splice(pack(ITEMS), changed), splice(ITEMS, changed))


def test_a_packed_body_switches_its_outputs_off_first() -> None:
    assert same(switch_off_first(pack(ITEMS)), switch_off_first(ITEMS))


def test_the_columns_of_a_packed_body_are_those_of_its_instructions() -> None:
    plain, packed = Columns(ITEMS), Columns(pack(ITEMS))
    moves = [item for item in ITEMS if isinstance(item, (MoveJ, MoveL, MoveC))]
    assert same(plain.moves, moves)
    assert same(packed.moves, moves)
    assert same(packed.moves[1:4], moves[1:4])
    for columns in (plain, packed):
        assert columns.speed.tolist() == [move.speed for move in moves]
        assert columns.blend.tolist() == [move.blend for move in moves]
        assert columns.path.tolist() == [move.path for move in moves]
        assert columns.works.tolist() == [move.work for move in moves]
        assert columns.force.tolist() == [getattr(move, "force", 0.0) for move in moves]
        assert columns.turn.tolist() == [getattr(move, "turn", 0.0) for move in moves]
        assert columns.share.tolist() == [getattr(move, "share", 0.0) for move in moves]
        assert columns.rate.tolist() == [getattr(move, "rate", 0.0) for move in moves]
        assert columns.posed.tolist() == [isinstance(move.target, Pose) for move in moves]
        ends = [list(move.target.origin) for move in moves if isinstance(move.target, Pose)]
        assert columns.ends[columns.posed].tolist() == ends
        assert columns.vias[columns.moves_are(MoveC)].tolist() == [[1.0, 1.0, 0.0], [3.0, 1.0, 0.0]]
        others = [item for item in ITEMS if isinstance(item, (Output, Wait))]
        assert same(columns.list_kinds(Output, Wait), others)
        assert columns.turned_as(TOOL_DOWN).tolist() == [
            isinstance(move.target, Pose) and move.target.rotation is TOOL_DOWN for move in moves
        ]
        before, after = columns.neighbours(np.arange(len(ITEMS)))
        for index, around in enumerate(zip(before, after, strict=True)):
            wanted = [[None, *take_motions(ITEMS[:index])][-1]]
            wanted.append([*take_motions(ITEMS[index + 1 :]), None][0])
            for motion, neighbour in zip(wanted, around, strict=True):
                assert (motion is None) == (neighbour is None)
                assert motion is None or same([motion], [neighbour])


def test_a_joint_speed_without_other_fields_is_kept() -> None:
    (move,) = pack([MoveJ(HERE, 50.0, rate=0.5)])
    assert move.rate == 0.5


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
@pytest.mark.parametrize("field", ["end", "via", "rotation", "via rotation", "speed"])
def test_a_number_that_is_not_finite_is_found_in_a_packed_body(number: float, field: str) -> None:
    bad, turned = (number, 0.0, 0.0), np.full((3, 3), number)
    values = {
        "end": (2.0, 0.0, 0.0),
        "via": (1.0, 1.0, 0.0),
        "rotation": TOOL_DOWN,
        "via rotation": TOOL_DOWN,
        "speed": 5.0,
    }
    wrong = {"end": bad, "via": bad, "rotation": turned, "via rotation": turned, "speed": number}
    values[field] = wrong[field]
    via, end = Pose(values["via rotation"], values["via"]), Pose(values["rotation"], values["end"])
    arc = MoveC(via, end, values["speed"])
    body = pack([MoveJ(HERE, 50.0), MoveL(HERE, 5.0), arc, MoveJ(HERE, 50.0)])
    with pytest.raises(Refused) as error:
        Program("bad", HERE, HERE, body)
    assert error.value.index == 2


def test_a_shared_rotation_is_once_in_the_table() -> None:
    body = pack([MoveL(Pose(TOOL_DOWN, (float(k), 0.0, 0.0)), 1.0) for k in range(5)])
    assert [rotation is TOOL_DOWN for rotation in body.rotations] == [True]
    targets = [item.target for item in body if isinstance(item, MoveL)]
    assert all(a.rotation is b.rotation for a, b in pairwise(targets))


def test_a_body_is_added_to_a_builder() -> None:
    shared = Pose(TOOL_DOWN, (1.0, 2.0, 3.0))
    more = pack([MoveL(shared, 5.0), Output("process", 0.0)])
    builder = BodyBuilder([MoveJ(shared, 10.0)])
    builder.extend_body(more)
    builder.append(MoveL(shared, 7.0))
    body = builder.body()
    assert len(builder) == len(body) == 4
    assert [type(item) for item in body] == [MoveJ, MoveL, Output, MoveL]
    assert [item.speed for item in body if not isinstance(item, Output)] == [10.0, 5.0, 7.0]
    assert len(body.rotations) == 1
    assert len(builder.objects) == 1


def test_later_instructions_do_not_change_a_body_that_was_built_before() -> None:
    builder = BodyBuilder(ITEMS[:8])
    before = builder.body()
    builder.extend(ITEMS[8:])
    builder.extend_body(pack(ITEMS))
    assert list(map(parts, before)) == list(map(parts, ITEMS[:8]))
    assert list(map(parts, builder.body())) == list(map(parts, [*ITEMS, *ITEMS]))


def test_a_stretch_of_a_body_has_its_instructions() -> None:
    body = pack(ITEMS)
    for low in range(len(ITEMS) + 1):
        for high in range(low, len(ITEMS) + 1):
            assert list(map(parts, body.stretch(low, high))) == list(map(parts, ITEMS[low:high]))
            assert list(map(parts, body.stretch(low, high).stretch(0, 1))) == list(
                map(parts, ITEMS[low:high][:1])
            )


def test_a_column_of_zeros_takes_no_memory() -> None:
    plain, pressing = (Columns(pack(items)) for items in (ITEMS[:7], ITEMS))
    assert (plain.force_direction.strides, plain.force_direction.shape) == ((0, 0), (4, 3))
    assert not plain.force_direction.any()
    assert pressing.force.tolist() == [getattr(move, "force", 0.0) for move in pressing.moves]
    assert pressing.force_direction[-3].tolist() == [0.0, 0.0, -1.0]
    arcs = pressing.arcs
    assert np.array_equal(pressing.vias_of(arcs[1:]), pressing.vias[arcs[1:]])
    assert np.isnan(np.delete(pressing.vias, arcs, axis=0)).all()


# Bodies that are made by column


def merge_singly(pieces: list[tuple[list[int], list[Instruction]]]) -> list[Instruction]:
    """The instructions of merged pieces, in order of place and then of piece."""
    placed: list[tuple[int, Instruction]] = []
    for places, items in pieces:
        placed += zip(places, items, strict=True)
    # The sort is stable.
    return [item for _, item in sorted(placed, key=itemgetter(0))]


PIECES = st.lists(
    st.lists(st.tuples(st.integers(0, 9), st.integers(0, len(ITEMS) - 1)), max_size=12),
    min_size=1,
    max_size=6,
)


@given(PIECES)
def test_merged_pieces_are_sorted_by_place_and_then_by_piece(
    drawn: list[list[tuple[int, int]]],
) -> None:
    pieces = []
    for piece in drawn:
        pieces.append(([place for place, _ in piece], [ITEMS[k] for _, k in piece]))
    given_up = [(np.array(places, np.intp), pack(items)) for places, items in pieces]
    body = merge(given_up)
    assert given_up == []
    wanted = merge_singly(pieces)
    assert same(body, wanted)
    assert same([body[k] for k in range(len(body))], wanted)
    assert len({id(rotation) for rotation in body.rotations}) == len(body.rotations)


def test_a_merged_body_shares_rotations_and_has_no_unused_ones() -> None:
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    table = [TOOL_DOWN, turned, IDENTITY]
    origin = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    pieces = [
        (np.array([1, 0]), lines(origin, [2, 2], table)),
        (np.array([0]), lines(origin[:1], [0], table)),
    ]
    body = merge(pieces)
    assert [id(move.target.rotation) for move in body] == [
        id(IDENTITY),
        id(TOOL_DOWN),
        id(IDENTITY),
    ]  # type: ignore[union-attr]
    assert [id(rotation) for rotation in body.rotations] == [id(IDENTITY), id(TOOL_DOWN)]


def lines(origin: np.ndarray, rotation: list[int], table: list[np.ndarray]) -> Body:
    targets = Targets(origin, np.array(rotation, np.int32), table)
    return make_plain_motions(
        MoveL, targets, speed=20.0, blend=0.0, path=np.zeros(len(origin), np.intp), work=True
    )


NUMBERS = st.floats(-1e4, 1e4)
ROWS = st.lists(
    st.tuples(
        st.tuples(NUMBERS, NUMBERS, NUMBERS),
        st.integers(0, 1),
        st.floats(0.1, 500.0),
        st.floats(0.0, 5.0),
        st.integers(-1, 9),
        st.none() | st.tuples(NUMBERS, NUMBERS, NUMBERS),
        st.integers(0, 1),
    ),
    max_size=12,
)


@given(ROWS, st.sampled_from([MoveJ, MoveL]), st.booleans())
def test_plain_motions_by_column_are_those_made_singly(
    rows: list, kind: type[MoveJ | MoveL], work: bool
) -> None:
    table = [IDENTITY, TOOL_DOWN]
    nowhere = (np.nan,) * 3
    columns = list(zip(*rows, strict=True)) if rows else [()] * 7
    end, turned, speed, blend, path, via, via_turned = columns
    middles = np.array([nowhere if point is None else point for point in via]).reshape(-1, 3)
    body = make_plain_motions(
        kind,
        Targets(
            np.array(end, np.float64).reshape(-1, 3),
            np.array(turned, np.int32),
            table,
            via=middles,
            via_rotation=np.array(via_turned, np.int32),
        ),
        speed=np.array(speed, np.float64),
        blend=np.array(blend, np.float64),
        path=np.array(path, np.intp),
        work=work,
    )
    wanted = []
    for origin, rotation, fast, zone, number, middle, via_rotation in rows:
        target = Pose(table[rotation], origin)
        if middle is not None:
            via_pose = Pose(table[via_rotation], middle)
            wanted.append(MoveC(via_pose, target, fast, zone, path=number, work=work))
        else:
            wanted.append(kind(target, fast, zone, path=number, work=work))
    assert same(body, wanted)


def test_plain_motions_may_share_a_speed_and_a_blend() -> None:
    body = lines(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), [0, 1], [IDENTITY, TOOL_DOWN])
    assert same(
        body,
        [
            MoveL(Pose(IDENTITY, (1.0, 2.0, 3.0)), 20.0, path=0, work=True),
            MoveL(Pose(TOOL_DOWN, (4.0, 5.0, 6.0)), 20.0, path=0, work=True),
        ],
    )
