"""Reads a STEP file as bodies of the CAD kernel, which are sewn, and joined where they touch.

The units of length and the uncertainty are read from its text.
"""

from __future__ import annotations

import os
import re
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from typing import Any

from msgspec import Struct

from camgen.model.errors import InputError, make_one_line
from camgen.model.files import Source
from camgen.model.limits import format_limit
from camgen.model.part import Note
from camgen.model.text import counted, harmless
from camgen.read.solid import kernel
from camgen.read.solid.healing import Body, choose_tolerance, join_touching, sew_bodies
from camgen.read.solid.part21 import LARGEST_ID, find_wild_id, find_wild_place, remove_faults
from camgen.read.units import MM

_SAVE_AGAIN = "export it again from the CAD program"
#: Maximum number of times that a text is read, each time without the damaged entities found before.
_MAX_READINGS = 4
#: Names that CAD programs write for entities without a name, and the start of an invented name.
_NO_NAMES = ("", "NONE", "NULL")
_INVENTED = "Open CASCADE STEP translator"
#: A change by the kernel that is not reported: such a shell is sewn afterwards.
_SPLIT = "Improperly connected shell split into parts"


class StepBodies(Struct, frozen=True, eq=False):
    """The content of a STEP file.

    shape: all faces, mm; None without any.
    names: names of the bodies, "" for one without a name.
    curves: number of curves that are in no face.
    tolerance: largest distance of faces that were sewn, mm.
    notes: notes on repairs.
    """

    shape: Any
    names: tuple[str, ...]
    curves: int
    tolerance: float
    notes: tuple[Note, ...]


def read_bodies(source: Source) -> StepBodies:
    """The bodies in a STEP file.

    Raises InputError for a damaged file, and if the extra `step` is not installed.
    """
    try:
        kernel.import_ocp("STEPControl")
    except ImportError as error:
        raise InputError(
            source.name,
            "STEP needs the CAD kernel",
            "",
            "pip install '.[step]' in the folder of camgen",
        ) from error
    message = kernel.import_ocp("Message")
    # OCCT prints warnings. Only the command line may print.
    message.Message.DefaultMessenger_s().RemovePrinters(
        message.Message_PrinterOStream.get_type_descriptor_s()
    )
    _try_in_child(source)
    return _read_in_process(source)


def _try_in_child(source: Source) -> None:
    """Raise InputError for a file that ends the process of the kernel.

    OCCT does not check all values of a file. A wrong one may end the process without an exception,
    so a child process reads the file first.
    """
    if not hasattr(os, "fork"):
        return
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        with suppress(BaseException):  # the parent meets the same error and reports it
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # stderr of a crash is not shown
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_REAL, source.limits.step_seconds)
            _read_in_process(source)
        os._exit(0)
    ended = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(ended):
        what, remedy = "is damaged: it ends the CAD kernel", _SAVE_AGAIN
        if os.WTERMSIG(ended) == signal.SIGALRM:
            what = f"takes the CAD kernel more than {format_limit(source.limits.step_seconds)} s"
            remedy = f"{_SAVE_AGAIN}, or raise limits.step_seconds"
        raise InputError(source.name, what, "", remedy)


def _read_in_process(source: Source) -> StepBodies:
    try:
        reader, notes = _read_sound(source)
        shape = reader.OneShape() if reader.TransferRoots() else None
        if shape is None or shape.IsNull():
            return StepBodies(None, (), 0, 0.0, notes)
        return _heal(source.data, reader, shape, notes)
    except kernel.list_errors() as error:
        raise InputError(
            source.name, "is damaged: the CAD kernel cannot read it", "", _SAVE_AGAIN
        ) from error


def _heal(data: bytes, reader: Any, shape: Any, notes: tuple[Note, ...]) -> StepBodies:
    curves = len(list(kernel.list_subshapes(shape, "Edge", "Face")))
    bodies = list(_list_bodies(reader.WS().TransferReader(), shape, ""))
    if not bodies:
        return StepBodies(None, (), curves, 0.0, notes)
    tolerance, doubts = choose_tolerance(read_uncertainty(data), kernel.measure_diagonal(shape))
    bodies, sewing = sew_bodies(bodies, tolerance)
    whole, joints = join_touching(bodies, tolerance)
    return StepBodies(
        whole,
        tuple(body.name for body in bodies),
        curves,
        tolerance,
        (*notes, *_note_changes(reader, shape), *doubts, *sewing, *joints),
    )


def _list_bodies(transfer: Any, shape: Any, product: str) -> Iterator[Body]:
    """The bodies of a shape: its solids, and its shells and faces that belong to no solid.

    transfer: results of the kernel's reader, by which entities of the file are found.
    product: name of the product that contains the shape in an assembly, "" without one.
    """
    kinds = kernel.import_ocp("TopAbs").TopAbs_ShapeEnum
    usage = transfer.EntityFromShapeResult(shape, 1)
    entity = transfer.EntityFromShapeResult(
        shape.Located(kernel.import_ocp("TopLoc").TopLoc_Location()), 1
    )
    if isinstance(usage, kernel.import_ocp("StepRepr").StepRepr_NextAssemblyUsageOccurrence):
        product = _read_name(usage.RelatedProductDefinition().Formation().OfProduct()) or product
        name = product or _read_name(entity)
    else:
        name = _read_name(entity) or product
    is_solid = isinstance(entity, kernel.import_ocp("StepShape").StepShape_SolidModel)
    kind = shape.ShapeType()
    if kind == kinds.TopAbs_SOLID or is_solid:
        yield Body(name, shape, True)
    elif kind in (kinds.TopAbs_COMPOUND, kinds.TopAbs_COMPSOLID):
        for member in kernel.list_members(shape):
            yield from _list_bodies(transfer, member, product)
    elif kind in (kinds.TopAbs_SHELL, kinds.TopAbs_FACE):
        yield Body(name, shape, False)


def _read_name(entity: Any) -> str:
    """The name of an entity, "" without one or in an unknown encoding."""
    try:
        text = str(entity.Name().ToCString()).strip()
    except (AttributeError, UnicodeDecodeError):
        return ""
    is_given = text not in _NO_NAMES and not text.startswith(_INVENTED)
    return harmless(text) if is_given else ""


def _note_changes(reader: Any, shape: Any) -> list[Note]:
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
    return [
        Note(
            "repaired",
            f"{text} by the CAD kernel: {listed}",
            f"its edges are within {kernel.measure_tolerance(shape):.2g} mm of their faces",
        )
    ]


def _read_sound(source: Source) -> tuple[Any, tuple[Note, ...]]:
    """The kernel's reader for a text in which it can read every entity, and notes on the repairs.

    OCCT would leave out everything that needs a damaged entity, or end the process. A damaged
    entity that no edge needs is removed from the text. Raises InputError for other damage.
    """
    data, notes = source.data, tuple[Note, ...]()
    if wild := find_wild_id(data):
        raise InputError(
            source.name,
            f"is damaged: {wild} is not the number of an entity, which is 1 to {LARGEST_ID}",
            "",
            _SAVE_AGAIN,
        )
    if far := find_wild_place(data, source.limits.step_place):
        raise InputError(
            source.name,
            f"is damaged: a point at {far}, no part is so large",
            "",
            f"{_SAVE_AGAIN}, or raise limits.step_place",
        )
    for _ in range(_MAX_READINGS):
        reader = kernel.import_ocp("STEPControl").STEPControl_Reader()
        if reader.ReadStream(source.name, BytesIO(data)).name != "IFSelect_RetDone":
            raise InputError(source.name, "is not a STEP file, or damaged", "", _SAVE_AGAIN)
        model = reader.StepModel()
        faults = _list_faults(model)
        if not faults:
            if model.GlobalCheck(True).HasFailed():
                raise InputError(
                    source.name, "is damaged: entities are missing or there twice", "", _SAVE_AGAIN
                )
            return reader, notes
        repaired = remove_faults(data, faults)
        if repaired.why:
            entities = counted(int(model.NbEntities()), "entity", "entities")
            raise InputError(
                source.name,
                f"is damaged: {len(faults)} of {entities} cannot be read, "
                f"and the part needs {repaired.why}",
                "",
                _SAVE_AGAIN,
            )
        data, notes = repaired.data, (*notes, *repaired.notes)
    raise InputError(source.name, "is damaged: its entities cannot be read", "", _SAVE_AGAIN)


def _list_faults(model: Any) -> dict[int, list[str]]:
    """Messages of OCCT about each entity that it cannot read, by the index of the entity."""
    faults = {}
    for k in range(1, int(model.NbEntities()) + 1):
        if model.IsErrorEntity(k):
            check = model.ReportEntity(k).Check()
            faults[k - 1] = [str(check.CFail(i)) for i in range(1, check.NbFails() + 1)]
    return faults


# Units.

_CONTEXT = re.compile(rb"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\(([^)]*)\)")
_INSTANCE = re.compile(rb"#(\d+)\s*=\s*\((?=[^;]*\bLENGTH_UNIT\b)([^;]*);")
_CONVERTED = re.compile(rb"CONVERSION_BASED_UNIT\s*\(\s*'([^']*)'")
_SI = re.compile(rb"SI_UNIT\s*\(\s*(\$|\.\w+\.)\s*,\s*\.METRE\.")
_UNCERTAINTY = re.compile(
    rb"UNCERTAINTY_MEASURE_WITH_UNIT\s*\(\s*LENGTH_MEASURE\s*\(\s*([-+.\dEe]+)\s*\)\s*,\s*#(\d+)"
)
_PREFIX = {
    b"$": "m",
    b".MILLI.": "mm",
    b".CENTI.": "cm",
    b".DECI.": "dm",
    b".MICRO.": "um",
    b".KILO.": "km",
}


def read_units(source: Source) -> tuple[str, list[Note]]:
    """The units of length of the shapes of a file for the user, and notes.

    The kernel converts the lengths. Raises InputError for a file of another kind.
    """
    data = source.data
    if not data[:4096].lstrip().startswith(b"ISO-10303-21"):
        raise InputError(source.name, "is not a STEP file", "it does not begin with ISO-10303-21")
    lengths = _list_units(data)
    used = {ref.strip(b" \t\r\n#") for ref in b",".join(_CONTEXT.findall(data)).split(b",")}
    names = sorted({lengths[ref] for ref in used if ref in lengths})
    if not names:
        return "mm", [
            Note("assumed", "1 unit of the file = 1 mm", "the file states no unit of length")
        ]
    return ", ".join(names), []


def read_uncertainty(data: bytes) -> float:
    """The largest uncertainty of lengths that a STEP file states, mm; 0 if it states none."""
    units = _list_units(data)
    stated = _UNCERTAINTY.findall(data)
    lengths = [float(value) * MM.get(units.get(unit, ""), 1.0) for value, unit in stated]
    return max(lengths, default=0.0)


def _list_units(data: bytes) -> dict[bytes, str]:
    """The names of the units of length, by the numbers of their entities."""
    return {number: _name_unit(text) for number, text in _INSTANCE.findall(data)}


def _name_unit(text: bytes) -> str:
    converted, si = _CONVERTED.search(text), _SI.search(text)
    if converted:
        return make_one_line(converted[1].decode("ascii", "replace")).lower().replace("metre", "m")
    return _PREFIX.get(si[1], "unknown") if si else "unknown"
