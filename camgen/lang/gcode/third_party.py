"""Reads a line of a third-party program in the dialect of its controller.

A value that the text does not state is an assumption. A line that the controller refuses is a
finding, and an effect that no other machine has is a loss. The run continues after both.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import reduce
from operator import xor

from camgen.lang.gcode.arcs import PLANES
from camgen.lang.gcode.dialects import LOSSES, OWN_WORDS
from camgen.lang.gcode.machine import ARCS, AXES, Machine
from camgen.lang.gcode.macros import assign, take_arguments
from camgen.lang.gcode.words import (
    BLANKS,
    COMMENT,
    GROUP,
    Line,
    LineError,
    Parameters,
    UnknownWord,
    bare,
    drop_comments,
    take_whole,
    without_number,
    words_of,
)
from camgen.model.program import Output

_TEXT = re.compile(
    r"[ \t]*(?:[nN][0-9]+)?[ \t]*[mM](?:117|118|23|28|30|32|98[ \t]*P\")\b[^;]*[A-Za-z]{3}"
)
_MACRO = re.compile(r"[ \t]*[A-Za-z_]{3,}(?![\[#])|[ \t]*\{")
_QUOTED = re.compile(r'"[^"]*"?')
#: A code with a text. The text of M115 is a version of the firmware, such as U3.8.1.
_TEXTS = re.compile(r"^([ \t]*(?:[nN][0-9]+[ \t]*)?[mM](?:115\b|[0-9.]+(?=.*[A-Za-z]{2}))).*")
_FLAG = re.compile(r"([A-Za-z])(?=[ \t]*(?:[A-Za-z]|$))")
_EXPONENT = re.compile(
    r"[A-FH-LN-Z][ \t]*[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)E[-+]?[0-9]+(?![.0-9])", re.IGNORECASE
)
_HAS_E = re.compile(r"g76|m6[78]")
_LOGS = re.compile(r"[ \t]*\([ \t]*(?:probeopen|probeclose)\b", re.IGNORECASE)
_PLAIN = re.compile(r"(?:[a-z][+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))*")
#: A line as a host sends it to a printer: its text, and the exclusive or of its bytes.
_CHECKED = re.compile(r"([ \t]*[nN][0-9]+[^*;]*)\*([0-9]{1,3})[ \t]*")
#: Blanks between two digits, such as "Y5 600".
_SPLIT = re.compile(r"[ \t](?<=[0-9.][ \t])[ \t]*[0-9.]")
_SPLIT_NUMBER = re.compile(r"(?:[A-Za-z][ \t]*)?(?:[-+][ \t]*)?[0-9.]+(?:[ \t]+[0-9.]+)+")
#: The rest of such a number from its first blank on.
_SPLIT_END = re.compile(r"(?<=[0-9.])[ \t]+[0-9.][0-9. \t]*")
#: Names of parameters and of files, which may have blanks.
_NAMED = re.compile(r'<[^<>]*>|"[^"]*"?')
_PARTS = dict(zip("UVW", AXES, strict=True))
_WORKING = ("G1", *ARCS)
#: Words that a cycle keeps until its line has its feed, by group.
_CYCLE_WORDS = {"circular pocket": "DIKLQXYZ", "turning": "DEIKLPQRUWXZ"}
_NO_HEIGHT = "begin the program with its height (G0 Z5)"
_IN_STEP = "the spindle keeps step with the feed, for which programs here have no word"
_PROBES = "probes: how far it goes is not in the text"
#: Codes whose effect depends on their machine, with the reason.
_OF_ITS_MACHINE = {
    **dict.fromkeys(("G33", "G33.1", "G76"), f"cuts a thread: {_IN_STEP}"),
    **dict.fromkeys(("G74", "G84"), f"taps: {_IN_STEP}"),
    **dict.fromkeys(("G38.2", "G38.3", "G38.4", "G38.5"), _PROBES),
    **dict.fromkeys(
        ("G70", "G71", "G71.1", "G71.2", "G72", "G72.1", "G72.2"), "is of a lathe: the part turns"
    ),
    "G7": "is of a lathe: X is a diameter",
    "G87": "stops the spindle at an angle and goes in beside the hole",
    "G88": "lets the operator bring the tool up",
    "G96": "is of a lathe: the spindle turns faster towards the centre",
    "M19": "turns the spindle to an angle",
    "M66": "waits for an input",
}
#: Codes that must not come while the coordinates are rotated.
_SHIFTS = frozenset(["G52", "G92", *(f"G{n}" for n in range(54, 60))])
#: Codes that use the axis words of a line for themselves.
_TAKE_AXES = frozenset(["G10", "G28", "G30", "G52", "G92"])


# -- text -> codes and words -----------------------------------------------------------------------


def clean(m: Machine, raw: str) -> str:
    """The words of a line as its controller reads them. Raises LineError."""
    m.raw, dialect = raw, m.dialect
    if dialect.name == "iso" and raw.lstrip().startswith("["):
        # A comment of WinCNC.
        return ""
    if raw.startswith(("\ufeff", "\xef\xbb\xbf")):
        raw = raw.lstrip("\ufeff\xef\xbb\xbf")
    start, shown = raw.lstrip(), raw.strip()[:40]
    if dialect.name == "grbl" and start[:1] in ("$", "?", "!", "~"):
        m.log.fact("settings of the machine", shown)
        if start[:2].upper() in ("$J", "$H"):
            m.log.lose(f"{shown}: a motion of GRBL beside the program")
        return ""
    if dialect.extruder and (_TEXT.match(raw) or (_MACRO.match(raw) and start[:1] != "(")):
        shown = raw.partition(";")[0].strip()[:40]
        m.log.fact("not evaluated", shown)
        m.log.lose(f"{shown} is not evaluated")
        return ""
    if dialect.name.startswith("fanuc") and start[:1] in ("%", ":"):
        return ""
    why = "whether they are depends on a switch of the operator"
    if start[:1] == "/" and m.assume("lines with / are run", "block_delete", why=why):
        return ""
    if dialect.nested or dialect.name == "grbl":
        text = drop_comments(raw, dialect.nested)
        text = _clean_for_printer(m, text) if dialect.extruder else text
        return without_number(text.translate(BLANKS).lower().lstrip("/").removesuffix("%"))
    if _LOGS.match(raw):
        m.log.fact("left out", shown)
        return ""
    return bare(raw)


def _clean_for_printer(m: Machine, text: str) -> str:
    """The line that a printer reads, without its checksum and its texts.

    A text in quotes becomes 0, a number ends at its first blank, and a letter without a number is a
    flag of 0.
    """
    line = _CHECKED.fullmatch(m.raw)
    if line is not None:
        checksum = reduce(xor, line[1].encode("latin-1", "replace"))
        if checksum != int(line[2]):
            what = f"checksum {line[2]}, and that of the line is {checksum}: the line was changed"
            m.log.find("unusual", f"{what}; a printer asks the host for it again")
    text = _SPLIT_END.sub("", _QUOTED.sub("0", text.partition("*")[0]))
    return _FLAG.sub(r"\1 0", _TEXTS.sub(r"\1", text))


def find_split_numbers(m: Machine, lines: Sequence[str]) -> None:
    """Adds a finding for each number with blanks in it."""
    is_printer = m.dialect.extruder
    for line, raw in enumerate(lines, 1):
        if not _SPLIT.search(raw) or raw.lstrip().startswith("["):
            continue
        if is_printer and (_TEXT.match(raw) or _MACRO.match(raw)):
            continue
        split = _SPLIT_NUMBER.search(_NAMED.sub("", drop_comments(raw, m.dialect.nested)))
        if split:
            number = _SPLIT_END.sub("", split[0]) if is_printer else split[0]
            rule = "a printer ends a number at a blank" if is_printer else "blanks are ignored"
            m.log.find(
                "dangerous", f"{split[0]} is read as {number.translate(BLANKS)}: {rule}", line=line
            )


def parse(m: Machine, text: str, known: Parameters) -> Line:
    """The codes by group and the words of a line.

    Adds a loss for each code whose effect depends on its machine. Raises LineError. In a dialect
    with open codes, an unreadable line may be a macro: it raises UnknownWord.
    """
    dialect = m.dialect
    if dialect.letters:
        _check_plain(text, dialect.name, dialect.letters)
    if "e" in text and not dialect.extruder:
        _check_exponents(m.raw, text)
    try:
        if dialect.increments and _is_assignment(text, known):
            return {}, {}
        codes, words = words_of(text, known, lambda code: _find_group(m, code))
    except LineError as error:
        if dialect.open and str(error).startswith("cannot read"):
            raise UnknownWord(f"{error}; later lines may depend on it") from error
        raise
    for code in codes.values():
        usual = dialect.names.get(code, code)
        if usual in _OF_ITS_MACHINE:
            m.log.lose(f"{code} {_OF_ITS_MACHINE[usual]}")
    return codes, words


def _check_plain(text: str, name: str, letters: str) -> None:
    odd = _PLAIN.sub("", text, count=1)
    if odd:
        raise LineError(f"cannot read {odd[:12]!r}: {name} takes letters with plain numbers alone")
    for letter in text:
        if letter.isalpha() and letter not in letters:
            raise LineError(f"{letter.upper()} is not a word of {name}")


def _check_exponents(raw: str, text: str) -> None:
    """Raises LineError for a number such as 1.2E-07, unless E is a word of G76, M67 or M68."""
    number = _EXPONENT.search(COMMENT.sub("", raw))
    if number and not _HAS_E.search(text):
        what = "which G-code does not have; write it with its decimals"
        raise LineError(f"{number[0]} is a number with an exponent, {what}")


def _is_assignment(text: str, known: Parameters) -> bool:
    """Whether a line only sets a parameter, as a macro of Fanuc. Raises LineError."""
    try:
        return assign(text, known)
    except LineError as error:
        if str(error).startswith("cannot read"):
            # Words may follow the value.
            return False
        raise


def _find_group(m: Machine, code: str) -> str:
    """The modal group of a code. An idle or an unknown code has its own group. Raises LineError."""
    dialect = m.dialect
    if code in dialect.idle:
        return f"idle {code}"
    meant = dialect.names.get(code, code)
    known = dialect.codes.get(code) if meant == code else GROUP.get(meant)
    if known is not None:
        return known
    if not dialect.open:
        raise LineError(f"{code} is not a code of {dialect.name}")
    return f"unknown {code}"


# -- codes of some controllers, which run before the other codes of a line -------------------------


def begin(m: Machine, codes: dict[str, str], words: dict[str, float]) -> None:
    """Runs what only some controllers have; renames and removes their codes. Raises LineError."""
    dialect = m.dialect
    _rename(m, codes, words)
    _find_refused(m, codes, words)
    if "S" in words and dialect.has_beams and codes.get("motion", m.motion) in _WORKING:
        m.varies_power |= any(axis in words for axis in AXES)
    _begin_wider(m, codes, words)
    if "subprogram" in codes:
        _call(m, codes["subprogram"], words)
    if dialect.extruder:
        _read_printer_words(m, codes, words)
    if dialect.increments:
        _add_increments(m, codes, words)
    if dialect.diameter:
        _read_lathe_words(m, codes, words)
    if m.lathe and "X" in words:
        words["X"] /= 2


def _rename(m: Machine, codes: dict[str, str], words: dict[str, float]) -> None:
    """Gives the codes of the dialect their usual names, and removes those of no modal group."""
    for group in list(codes):
        kind, _, code = group.partition(" ")
        if kind == "idle":
            del codes[group]
            _leave_out(m, code, codes, words)
        elif kind == "unknown":
            del codes[group]
            _pass_over(m, code, codes, words)
    for group, code in codes.items():
        codes[group] = m.dialect.names.get(code, code)


def _leave_out(m: Machine, code: str, codes: dict[str, str], words: dict[str, float]) -> None:
    """Removes the words of a code that moves nothing. Raises UnknownWord."""
    dialect = m.dialect
    effect = dialect.idle[code]
    m.log.fact(effect, code)
    if effect in LOSSES:
        m.log.lose(f"{code}: {effect}")
    if dialect.extruder and code in ("M82", "M83"):
        m.filament_adds = code == "M83"
    if code[0] == "M":
        if dialect.extruder or not any(axis in words for axis in AXES):
            _remove_words(words, "" if dialect.extruder else "FST")
    elif "motion" not in codes and effect in LOSSES:
        _remove_words(words, "FT")
    elif "motion" not in codes:
        _take_own_words(m, code, codes, words)


def _take_own_words(m: Machine, code: str, codes: dict[str, str], words: dict[str, float]) -> None:
    """Removes the words that belong to a code. The others are those of the modal motion.

    Raises UnknownWord for axis words whose meaning depends on the machine.
    """
    is_preset = code == "G50" and m.dialect.diameter
    if is_preset:
        m.most_turns = words.get("S", m.most_turns)
    for letter in OWN_WORDS.get(code, ""):
        words.pop(letter, None)
    if code in ("G50", "G60") and any(axis in words for axis in "XYZUVW"):
        if not is_preset:
            raise UnknownWord(f"what {code} does with axis words depends on the machine")
        codes["offsets"] = "G92"


def _pass_over(m: Machine, code: str, codes: Mapping[str, str], words: dict[str, float]) -> None:
    """Adds a loss for an unknown code. Raises UnknownWord if it may be a motion."""
    if code[0] == "G" and "motion" not in codes and any(axis in words for axis in "XYZIJKR"):
        raise UnknownWord(f"{code} is not known, and later lines depend on where it ends")
    what = f"{code} is not known and not evaluated"
    m.log.fact("not evaluated", code)
    m.log.lose(what)
    if code[0] == "G":
        m.log.find("unusual", what, once=code)
    if "motion" not in codes and (m.dialect.extruder or not any(axis in words for axis in AXES)):
        _remove_words(words, "FST")


def _remove_words(words: dict[str, float], kept: str) -> None:
    for letter in [letter for letter in words if letter not in kept]:
        del words[letter]


def _find_refused(m: Machine, codes: Mapping[str, str], words: Mapping[str, float]) -> None:
    dialect = m.dialect
    if not dialect.open and "motion" in codes and codes.get("offsets") in _TAKE_AXES:
        m.log.find(
            "refused",
            f"{codes['motion']} and {codes['offsets']} both use the axis words of the line",
        )
    if not dialect.open and "mist" in codes and "flood" in codes:
        m.log.find("refused", "M7 and M8 are of one group (coolant)")
    arc = codes.get("motion", m.motion)
    if dialect.ends_arcs and arc in ARCS and any(letter in words for letter in "IJKR"):
        first, second, _ = (AXES[k] for k in PLANES[codes.get("plane", m.plane)])
        if first not in words and second not in words:
            m.log.find(
                "refused", f"{arc} names neither {first} nor {second}: {dialect.name} rejects it"
            )


def _begin_wider(m: Machine, codes: dict[str, str], words: dict[str, float]) -> None:
    """Removes codes and words that only some controllers have."""
    m.cycle = None
    for group, used in _CYCLE_WORDS.items():
        if group in codes:
            kept = {letter: words.pop(letter) for letter in [*words] if letter in used}
            m.cycle = (group, codes.pop(group), kept)
    for group in ("rotation", "modal macro"):
        if group in codes:
            m.plane = codes.get("plane", m.plane)
            m.profile.handlers[group](m, codes.pop(group), words)
    m.moving = any(letter in words for letter in "XYZUVW") and "offsets" not in codes
    if m.rotation is not None and _SHIFTS & set(codes.values()):
        what = "the origin is moved while the coordinates are rotated (G68)"
        m.log.find("unusual", what, once="rotated")
        m.log.lose(what)


def _call(m: Machine, code: str, words: dict[str, float]) -> None:
    """M97, M98 and G65 call a subprogram, and M99 ends it, or the program."""
    number, times = words.pop("P", 0.0), take_whole(words, "L", 1)
    if code == "M98" and number >= 10_000 and m.dialect.name.startswith("fanuc"):
        number, times = number % 10_000, int(number) // 10_000
    if code == "M99" and not m.depth:
        m.log.fact("left out", "M99 begins the program again; it is run once")
        m.ended = True
        return
    arguments = take_arguments(words) if code == "G65" else None
    m.leap = code, number, times, arguments


def _read_printer_words(m: Machine, codes: Mapping[str, str], words: dict[str, float]) -> None:
    """Words of a printer: S is the time of a dwell, s; E feeds filament."""
    if "dwell" in codes and "S" in words:
        words["P"] = words.pop("S") * 1000.0
    if "E" not in words:
        return
    value = words.pop("E")
    if codes.get("offsets") == "G92":
        m.at_filament = value
        return
    m.filament += value if m.filament_adds else value - m.at_filament
    if value != (0.0 if m.filament_adds else m.at_filament):
        m.log.lose("E feeds filament: only X, Y and Z are replayed")
    m.at_filament = m.at_filament + value if m.filament_adds else value
    if m.motion == "G0" and "motion" not in codes:
        m.motion = "G1"


def _add_increments(m: Machine, codes: Mapping[str, str], words: dict[str, float]) -> None:
    """Adds U, V and W as increments to X, Y and Z."""
    for letter, axis in _PARTS.items():
        if letter not in words or axis in words:
            continue
        k = AXES.index(axis)
        # X and U of a lathe are diameters.
        factor = 2 if m.dialect.diameter and axis == "X" else 1
        words[axis] = words.pop(letter) / factor
        if not m.incremental:
            words[axis] += (m.turned(list(m.at), True)[k] - m.shift[k]) / m.scale
        words[axis] *= factor
        if "offsets" not in codes:
            m.known[k] = True


def _read_lathe_words(m: Machine, codes: dict[str, str], words: dict[str, float]) -> None:
    """Words of a lathe: T0102 is tool 1 with offset 2, and X is a diameter."""
    tool = words.get("T", 0.0)
    if tool >= 100 and tool % 1 == 0:
        words["T"] = tool // 100
        codes.setdefault("tool change", "M6")
    if "X" in words and not m.lathe:
        m.lathe = bool(m.assume("X is a diameter", "diameter", 1.0, "as on most lathes"))
        m.log.lose("a program of a lathe: the part turns, which no machine here does")


def end(m: Machine, words: dict[str, float]) -> None:
    """Runs the cycle and the macro of the line, and adds losses for words without a use.

    Raises LineError.
    """
    if m.cycle is not None:
        group, code, cycle_words = m.cycle
        m.profile.handlers[group](m, code, cycle_words)
    if m.modal is not None and m.moving and m.leap is None and m.depth == m.modal_depth:
        m.leap = m.modal
    if not m.dialect.open:
        return
    for letter in [letter for letter in words if letter != "F"]:
        words.pop(letter)
        what = f"word {letter}: nothing in the line uses it"
        # The number of an offset, which a later line may use.
        if letter in "HD":
            m.log.fact("left out", what)
        else:
            m.log.find("unusual", what, once=f"idle {letter}")
            m.log.lose(what)


# -- motions ---------------------------------------------------------------------------------------


def prepare_motion(m: Machine, code: str, words: Mapping[str, float], cycle: bool) -> None:
    """Checks units, spindle, compensation and tool length before a motion.

    code: code of the line.
    """
    if m.unit is None:
        why = "neither G20 nor G21 stands before the first motion"
        m.unit = 25.4 if m.assume("lengths are mm", "inch", why=why) else 1.0
    is_working = "G0" not in (code, m.motion)
    if m.adrift:
        m.adrift -= {k for k, axis in enumerate(AXES) if axis in words and not m.incremental}
        if m.adrift and is_working:
            names = " ".join(AXES[k] for k in sorted(m.adrift))
            m.log.find(
                "unusual",
                f"a motion at feed from where no line says: {names} came from a stored position",
                once="adrift",
            )
            m.adrift.clear()
    if m.spindle != "M5":
        m.halted = 0
    elif m.halted and (cycle or is_working):
        what = f"M6 stopped it (line {m.halted}), and no M3 follows"
        m.log.find("dangerous", f"cuts with a spindle that does not turn: {what}")
        m.halted = 0
    if cycle and m.side and not m.dialect.open:
        m.log.find("refused", f"{m.motion} with cutter compensation on")
    if m.left_path and m.motion in ARCS and not m.dialect.open:
        m.log.find("refused", f"{m.motion} right after G40: the way off the path is straight")
    m.left_path = False
    if "Z" in words and m.length == "G49" and m.reached and not cycle:
        m.log.find(
            "dangerous",
            "Z moves after G49 without the length of the tool: its tip goes lower by as much",
            once="G49",
        )
        m.reached = False
    m.length_at_z = m.length


def run_without_axes(m: Machine, code: str) -> None:
    """A motion code without axis words. Raises LineError for an arc."""
    if code in ARCS:
        raise LineError(f"{code} without an end point or centre")
    # LinuxCNC moves to the place where the tool stands.
    m.held += code in ("G0", "G1") and not m.has_position


def switch(m: Machine, signal: str, value: float) -> None:
    """Sets an output. A switch at an unknown height is a loss."""
    if m.held > 0 and not m.has_position and not value:
        switched_on = {item.signal for item in m.body if isinstance(item, Output) and item.value}
        if signal in switched_on:
            m.log.lose(f"{signal} is on and off again where Z is not known; {_NO_HEIGHT}")
    m.add(Output(signal, value))
