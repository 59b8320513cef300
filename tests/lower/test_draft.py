"""Instructions that are put at places, a kind at a time, against lists of lists of them."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from camgen.lower.draft import Draft
from camgen.model.body import pack
from camgen.model.pose import IDENTITY, TOOL_DOWN, Pose
from camgen.model.program import Comment, Force, Instruction, MoveC, MoveJ, MoveL, Output
from tests.model.test_body import same


def line(x: float, **more: float) -> MoveL:
    return MoveL(Pose(TOOL_DOWN, (x, 0.0, 0.0)), 20.0, **more)


#: Of every kind that a draft gets, each told from all others.
KINDS: tuple[Instruction, ...] = (
    Comment("path c1"),
    MoveJ(Pose(IDENTITY, (9.0, 8.0, 7.0)), 100.0),
    line(1.0),
    line(2.0, blend=0.3),
    line(3.0, force=5.0),
    MoveC(Pose(IDENTITY, (1.0, 1.0, 0.0)), Pose(TOOL_DOWN, (2.0, 0.0, 0.0)), 7.0),
    Output("process", 1.0),
    Force(0.0),
)
#: What is done with a draft: places are opened, items put at some of those opened last, or added behind all.
Step = tuple[str, int, list[tuple[int, int]]]
STEPS = st.lists(
    st.tuples(
        st.sampled_from(["open", "put", "put", "put", "add"]),
        st.integers(1, 4),
        st.lists(st.tuples(st.integers(0, 1000), st.integers(0, len(KINDS) - 1)), max_size=6),
    ),
    max_size=12,
)


def run(steps: list[Step], packed: bool) -> tuple[list[Instruction], list[Instruction]]:
    """What a draft makes of some steps, and what lists do: one of the items of each place, in the order of the puts."""
    draft, begin = Draft(), 0
    slots: list[list[Instruction]] = []
    draft.add(KINDS[0])
    slots.append([KINDS[0]])
    for step, count, chosen in steps:
        items = [KINDS[k] for _, k in chosen]
        if step == "open":
            draft.open(count)
            begin = len(slots)
            slots += [[] for _ in range(count)]
        elif step == "add":
            draft.add(*items)
            begin = len(slots)
            slots.append(items)
        else:
            places = [at % (len(slots) - begin) for at, _ in chosen]
            draft.insert(np.array(places, np.intp), pack(items) if packed else items)
            for place, item in zip(places, items, strict=True):
                slots[begin + place].append(item)
    return list(draft.body()), [item for slot in slots for item in slot]


@given(STEPS, st.booleans())
def test_a_draft_is_lists_of_what_stands_at_each_place(steps: list[Step], packed: bool) -> None:
    made, wanted = run(steps, packed)
    assert same(made, wanted)


def test_what_is_put_first_comes_first_at_a_place_and_places_come_before_that() -> None:
    draft = Draft()
    draft.add(Comment("begin"))
    draft.open(3)
    draft.insert(np.array([2, 0]), [Comment("c first"), Comment("a first")])
    draft.insert(np.array([0, 1, 2]), [Comment("a second"), Comment("b"), Comment("c second")])
    draft.add(Comment("end"), Comment("of all"))
    found = [item.text for item in draft.body() if isinstance(item, Comment)]
    assert found == ["begin", "a first", "a second", "b", "c first", "c second", "end", "of all"]


def test_a_draft_is_used_up_by_its_body() -> None:
    draft = Draft()
    draft.add(Comment("one"))
    assert len(draft.body()) == 1
    draft.add(Comment("two"))
    assert same(draft.body(), [Comment("two")])
