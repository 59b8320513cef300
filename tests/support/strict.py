"""What a read-back finds in a program with one change."""

from collections.abc import Mapping

from camgen.post import Readback, Remark


def find_after(
    read: Readback, text: str, options: Mapping[str, object], before: str, after: str
) -> list[tuple[int, bool, str]]:
    """Line, counted from the change, whether it is a remark, and words of all that is found in ``text`` with ``after``
    in the first place of ``before``. As it is, nothing may be found in it.
    """
    assert read({"part": text}, options).faults == ()
    assert before in text, text
    changed = text.count("\n", 0, text.index(before)) + 1
    found = read({"part": text.replace(before, after, 1)}, options).faults
    return [(one.line - changed, isinstance(one, Remark), one.what) for one in found]
