"""A draft, into whose slots instructions are inserted by kind, against lists of lists."""

from __future__ import annotations

from itertools import chain

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


#: Instructions of every kind that a draft gets, all different.
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
#: Slots are opened, items are inserted into the slots that were opened last, or added at the end.
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
    """The body of a draft after `steps`, and the same from one list of items per slot."""
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
    return list(draft.body()), list(chain.from_iterable(slots))


@given(STEPS, st.booleans())
def test_the_body_of_a_draft_has_the_items_of_each_slot(steps: list[Step], packed: bool) -> None:
    body, expected = run(steps, packed)
    assert same(body, expected)


def test_items_are_ordered_by_slot_and_within_a_slot_by_insertion() -> None:
    draft = Draft()
    draft.add(Comment("begin"))
    draft.open(3)
    draft.insert(np.array([2, 0]), [Comment("c first"), Comment("a first")])
    draft.insert(np.array([0, 1, 2]), [Comment("a second"), Comment("b"), Comment("c second")])
    draft.add(Comment("end"), Comment("of all"))
    texts = [item.text for item in draft.body() if isinstance(item, Comment)]
    assert texts == ["begin", "a first", "a second", "b", "c first", "c second", "end", "of all"]


def test_a_draft_is_empty_after_its_body_was_made() -> None:
    draft = Draft()
    draft.add(Comment("one"))
    assert len(draft.body()) == 1
    draft.add(Comment("two"))
    assert same(draft.body(), [Comment("two")])
