"""The bytes of a STEP file as bodies of the CAD kernel: sewn, and joined where they touch."""

from __future__ import annotations

import os
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from typing import Any

from msgspec import Struct

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.limits import format_limit
from camgen.model.part import Note
from camgen.model.text import counted, harmless
from camgen.read.solid import kernel
from camgen.read.solid.healing import Body, choose_tolerance, join_touching, sew_bodies
from camgen.read.solid.part21 import LARGEST_ID, find_wild_id, find_wild_place, take_out
from camgen.read.solid.step_units import read_uncertainty

_SAVE_AGAIN = "export it again from the CAD program"
#: The text is read again without damaged entities, at most this many times.
_ROUNDS = 4
#: Names that CAD programs write for entities without a name, and how an invented one begins.
_NO_NAMES = ("", "NONE", "NULL")
_INVENTED = "Open CASCADE STEP translator"


class StepBodies(Struct, frozen=True, eq=False):
    """The content of a STEP file.

    shape: all faces, mm; None without any.
    names: names of the bodies, "" for one without a name.
    curves: number of curves that are in no face.
    tolerance: largest distance of faces that were sewn, mm.
    """

    shape: Any
    names: tuple[str, ...]
    curves: int
    tolerance: float
    notes: tuple[Note, ...]


def load(source: Source) -> StepBodies:
    """The bodies in a STEP file. Raises InputError for a file that is damaged."""
    try:
        kernel.part("STEPControl")
    except ImportError as error:
        raise InputError(
            source.name,
            "STEP needs the CAD kernel",
            "",
            "pip install '.[step]' in the folder of camgen",
        ) from error
    message = kernel.part("Message")
    # OCCT prints what it finds odd; the command line alone prints.
    message.Message.DefaultMessenger_s().RemovePrinters(
        message.Message_PrinterOStream.get_type_descriptor_s()
    )
    _try_aside(source)
    return _load(source)


def _try_aside(source: Source) -> None:
    """Raises InputError for a file that ends the process of the kernel: a child reads it first.

    OCCT does not check all values of a file; a wrong one may end the process without an exception.
    """
    if not hasattr(os, "fork"):
        return
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        with suppress(BaseException):  # the parent meets the same error and reports it
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # its last words are of no use
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_REAL, source.limits.step_seconds)
            _load(source)
        os._exit(0)
    ended = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(ended):
        what, remedy = "is damaged: it ends the CAD kernel", _SAVE_AGAIN
        if os.WTERMSIG(ended) == signal.SIGALRM:
            what = f"takes the CAD kernel more than {format_limit(source.limits.step_seconds)} s"
            remedy = f"{_SAVE_AGAIN}, or raise limits.step_seconds"
        raise InputError(source.name, what, "", remedy)


def _load(source: Source) -> StepBodies:
    failure = kernel.part("Standard").Standard_Failure
    try:
        reader, notes = _sound(source)
        shape = reader.OneShape() if reader.TransferRoots() else None
        if shape is None or shape.IsNull():
            return StepBodies(None, (), 0, 0.0, notes)
        return _heal(source.data, reader, shape, notes)
    except (failure, *kernel.STUMBLES) as error:
        raise InputError(
            source.name, "is damaged: the CAD kernel cannot read it", "", _SAVE_AGAIN
        ) from error


def _heal(data: bytes, reader: Any, shape: Any, notes: tuple[Note, ...]) -> StepBodies:
    """The bodies of a shape, sewn and joined."""
    curves = kernel.count_wires(shape)
    bodies = list(_walk(reader.WS().TransferReader(), shape, ""))
    if not bodies:
        return StepBodies(None, (), curves, 0.0, notes)
    tolerance = choose_tolerance(read_uncertainty(data), kernel.size(shape))
    bodies, sewing = sew_bodies(bodies, tolerance.mm)
    whole, joints = join_touching(bodies, tolerance.mm)
    return StepBodies(
        whole,
        tuple(body.name for body in bodies),
        curves,
        tolerance.mm,
        (*notes, *_note_changes(reader, shape), *tolerance.notes, *sewing, *joints),
    )


def _walk(transfer: Any, shape: Any, product: str) -> Iterator[Body]:
    """The bodies of a shape: its solids, and all faces that belong to no solid.

    product: name of the product around the shape in an assembly.
    """
    kinds = kernel.part("TopAbs").TopAbs_ShapeEnum
    usage = transfer.EntityFromShapeResult(shape, 1)
    entity = transfer.EntityFromShapeResult(
        shape.Located(kernel.part("TopLoc").TopLoc_Location()), 1
    )
    if isinstance(usage, kernel.part("StepRepr").StepRepr_NextAssemblyUsageOccurrence):
        product = _name(usage.RelatedProductDefinition().Formation().OfProduct()) or product
        own_name = product or _name(entity)
    else:
        own_name = _name(entity) or product
    is_solid = isinstance(entity, kernel.part("StepShape").StepShape_SolidModel)
    kind = shape.ShapeType()
    if kind == kinds.TopAbs_SOLID or is_solid:
        yield Body(own_name, shape, True)
    elif kind in (kinds.TopAbs_COMPOUND, kinds.TopAbs_COMPSOLID):
        for member in kernel.members(shape):
            yield from _walk(transfer, member, product)
    elif kind in (kinds.TopAbs_SHELL, kinds.TopAbs_FACE):
        yield Body(own_name, shape, False)


def _name(entity: Any) -> str:
    """The name of an entity, "" without one or in an encoding that is not known."""
    try:
        text = str(entity.Name().ToCString()).strip()
    except (AttributeError, UnicodeDecodeError):
        return ""
    is_given = text not in _NO_NAMES and not text.startswith(_INVENTED)
    return harmless(text) if is_given else ""


def _note_changes(reader: Any, shape: Any) -> list[Note]:
    """The changes that the kernel made to faces and edges while it read them."""
    checks = reader.WS().TransferReader().TransientProcess().CheckList(False)
    changes: Counter[str] = Counter()
    checks.Start()
    while checks.More():
        check = checks.Value()
        changes.update(str(check.CWarning(k)) for k in range(1, check.NbWarnings() + 1))
        checks.Next()
    changes.pop(_SPLIT, None)
    if not changes:
        return []
    listed = ", ".join(f"{count} x {harmless(message)}" for message, count in changes.most_common())
    text = counted(changes.total(), "change")
    why = f"its edges are within {kernel.measure_tolerance(shape):.2g} mm of their faces"
    return [Note("repaired", f"{text} by the CAD kernel: {listed}", why)]


#: A shell in parts is sewn.
_SPLIT = "Improperly connected shell split into parts"


def _sound(source: Source) -> tuple[Any, tuple[Note, ...]]:
    """The kernel's reader of a text of which it can read every entity.

    OCCT would leave out whatever needs a damaged entity, or end the process. A damaged entity that
    no edge needs is taken out of the text. Raises InputError for other damage.
    """
    data, notes = source.data, tuple[Note, ...]()
    if wild := find_wild_id(data):
        what = f"is damaged: {wild} is not the number of an entity, which is 1 to {LARGEST_ID}"
        raise InputError(source.name, what, "", _SAVE_AGAIN)
    if far := find_wild_place(data, source.limits.step_place):
        remedy = f"{_SAVE_AGAIN}, or raise limits.step_place"
        raise InputError(
            source.name, f"is damaged: a point at {far}, no part is so large", "", remedy
        )
    for _ in range(_ROUNDS):
        reader = kernel.part("STEPControl").STEPControl_Reader()
        if reader.ReadStream(source.name, BytesIO(data)).name != "IFSelect_RetDone":
            raise InputError(source.name, "is not a STEP file, or damaged", "", _SAVE_AGAIN)
        model = reader.StepModel()
        faults = _faults(model)
        if not faults:
            if model.GlobalCheck(True).HasFailed():
                raise InputError(
                    source.name, "is damaged: entities are missing or there twice", "", _SAVE_AGAIN
                )
            return reader, notes
        mended = take_out(data, faults)
        if mended.why:
            of = counted(int(model.NbEntities()), "entity", "entities")
            what = (
                f"is damaged: {len(faults)} of {of} cannot be read, and the part needs {mended.why}"
            )
            raise InputError(source.name, what, "", _SAVE_AGAIN)
        data, notes = mended.data, (*notes, *mended.notes)
    raise InputError(source.name, "is damaged: its entities cannot be read", "", _SAVE_AGAIN)


def _faults(model: Any) -> dict[int, list[str]]:
    """Messages of OCCT about entities that it cannot read, by their place in the file from 0."""
    faults = {}
    for k in range(1, int(model.NbEntities()) + 1):
        if model.IsErrorEntity(k):
            check = model.ReportEntity(k).Check()
            faults[k - 1] = [str(check.CFail(i)) for i in range(1, check.NbFails() + 1)]
    return faults
