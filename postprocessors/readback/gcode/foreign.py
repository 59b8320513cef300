"""Programs that camgen did not write: read by the interpreter that replays them."""

from __future__ import annotations

from collections.abc import Sequence

from camgen.model.program import Instruction, Output
from camgen.post import Fault, Reading, Remark
from camgen.read.gcode.interpreter import interpret

from .state import Machine


def foreign(text: Sequence[str], m: Machine) -> Reading | None:
    """What the lines of a program say that has words that no post writes; None where it stops at the first of them.

    m: the machine that met those words. That they are there is a remark, so that a program of our own never passes.
    """
    run = interpret(text)
    if run.stopped and run.unread and run.stopped[0] <= m.unread:
        return None
    what = "a word that camgen does not write; the program is read as LinuxCNC runs it"
    faults: list[Fault] = [Remark(m.unread, what)]
    faults += [Remark(line, str(note)) for line, note in run.remarks]
    if run.stopped:
        faults.append(Fault(run.stopped[0], f"{run.stopped[1]}; nothing from here on is read"))
    elif not run.ended:
        faults.append(Fault(len(text), "the program has no end (M2 or M30)"))
    faults.sort(key=lambda fault: fault.line)
    return Reading(_named(run.body, m.expect.names), run.lines, tuple(faults))


def _named(body: Sequence[Instruction], names: dict[str, str]) -> tuple[Instruction, ...]:
    """The body with the names of ``post.signals`` for the outputs that have one."""
    known = {f"dout{word[1:]}": name for word, name in names.items() if word.startswith("P")}
    known |= {signal: names[word] for word, signal in (("M7", "mist"), ("M8", "flood")) if word in names}
    return tuple(
        Output(known[item.signal], item.value) if isinstance(item, Output) and item.signal in known else item
        for item in body
    )
