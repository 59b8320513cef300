"""Small programs of tests as whole ones: off before the first motion what they use, and off at the end."""

from collections.abc import Sequence

from camgen.model.program import Force, Instruction, Output, put_off_first


def whole(body: Sequence[Instruction]) -> tuple[Instruction, ...]:
    """``body`` between what switches off all outputs and the force that it uses, first and, where still on, last."""
    left: dict[str, float] = {}
    newtons = 0.0
    for item in body:
        if isinstance(item, Output):
            left[item.signal] = item.value
        elif isinstance(item, Force):
            newtons = item.newtons
    off = [Output(name, 0.0) for name, value in left.items() if value]
    return (*put_off_first(body), *off, *([Force(0.0)] if newtons else []))
