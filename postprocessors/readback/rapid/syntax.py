"""RAPID text as tokens: the lexical part of the read-back (RAPID kernel manual, chapter 2)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import lru_cache

from msgspec import Struct

from camgen.model.pose import Vec3
from camgen.post import Fault, Remark

_N = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_POINT = rf"\[\[{_N},{_N},{_N}\],\[{_N},{_N},{_N},{_N}\],\[{_N},{_N},{_N},{_N}\],\[{_N},{_N},{_N},{_N},{_N},{_N}\]\]"
_NAME = r"[A-Za-z][A-Za-z0-9_]*"
# A robtarget written out compactly, and a whole straight motion to one, are single tokens: a long program is made of
# these, and reading it takes seconds instead of half a minute. The general rules read the same from them.
_TOKEN = re.compile(
    rf"""[ \t\f\v]*(?:
    (?P<move>Move[LJ][ ]{_POINT},{_NAME},{_NAME},{_NAME}\\WObj:={_NAME};)
  | (?P<point>{_POINT})
  | (?P<newline>\n)
  | (?P<comment>![^\n]*)
  | (?P<name>{_NAME})
  | (?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)
  | (?P<string>"(?:[^"\n]|"")*")
  | (?P<mark>:=|[^ \t\f\v])
  | (?P<end>\Z)
    )""",
    re.VERBOSE,
)
_MOVE = re.compile(rf"(Move[LJ])[ ](.*\]\]),({_NAME}),({_NAME}),({_NAME})\\WObj:=({_NAME});")
#: The optional banner of old files: %%% VERSION:1 LANGUAGE:ENGLISH %%%.
_BANNER = re.compile(r"\A\s*%%%[A-Za-z0-9:\s]*%%%[ \t]*(?=\n)")
#: Its four lines (RAPID overview, file format).
_BANNER_LINES = "%%% VERSION:1 LANGUAGE:ENGLISH %%%".split()  # noqa: SIM905 (as it is written)
#: Never a name (RAPID kernel manual 2.4).
RESERVED = frozenset(
    """alias and backward case connect const default div do else elseif endfor endfunc endif endmodule endproc endrecord
    endtest endtrap endwhile error exit false for from func goto if inout local mod module nostepin not noview or pers
    proc raise readonly record retry return step sysmodule task test then to trap true trynext undo var viewonly while
    with xor""".split()  # noqa: SIM905 (sixty words read better so)
)
#: The largest value of a num (IEEE single precision).
LARGEST = 3.4e38
#: The longest string, and what stands in one for another character.
LONGEST_STRING = 80
_ESCAPED = re.compile(r'""|\\\\|\\([0-9a-fA-F]{2})')

Token = tuple[str, str, int, int]  # kind, text, line, offset of its start


class Wrong(Exception):
    """A fault found while something is being read; the reader notes it and goes on behind it."""

    def __init__(self, line: int, what: str) -> None:
        super().__init__(line, what)
        self.fault = Fault(line, what)


def banner(text: str) -> int:
    """The length of the banner that ``text`` begins with, if any."""
    found = _BANNER.match(text)
    return found.end() if found else 0


def tokens(text: str, first_line: int, start: int = 0) -> Iterator[Token]:
    """The tokens of ``text`` (LF line ends) from the offset ``start``, in ``first_line``, on; without comments."""
    line = first_line
    for match in _TOKEN.finditer(text, start):
        kind = match.lastgroup or "end"
        if kind == "newline":
            line += 1
        elif kind != "comment":
            yield kind, match[kind], line, match.start(kind)


def number(text: str, line: int) -> float:
    """The num that ``text`` writes out. Wrong when it is larger than one can be."""
    value = float(text)
    if abs(value) > LARGEST:
        raise Wrong(line, f"{text[:40]} is larger than a num can be")
    return value


def string(text: str, line: int) -> str:
    """The string that ``text`` writes out. Wrong when it is longer than one can be (RAPID kernel manual, strings)."""
    value = _ESCAPED.sub(lambda found: chr(int(found[1], 16)) if found[1] else found[0][0], text[1:-1])
    if len(value) > LONGEST_STRING:
        raise Wrong(line, f"a string of {len(value)} characters; a controller takes {LONGEST_STRING}")
    return value


def point(text: str, line: int) -> tuple[tuple[float, ...], ...]:
    """The numbers of the token ``point``, grouped as the manual groups them."""
    trans, rot, rest = text[2:-2].split("],[", 2)
    groups, largest = _groups(rest)
    position, q = tuple(map(float, trans.split(","))), tuple(map(float, rot.split(",")))
    if max(largest, *position, *q) > LARGEST or min(*position, *q) < -LARGEST:
        raise Wrong(line, "a number of a robtarget is larger than a num can be")
    return (position, q, *groups)


@lru_cache(maxsize=1000)
def _groups(text: str) -> tuple[tuple[tuple[float, ...], ...], float]:
    """Configuration and external axes, and the largest number in them: the same for many points."""
    groups = tuple(tuple(map(float, group.split(","))) for group in text.split("],["))
    return groups, max(abs(v) for group in groups for v in group)


def whole_move(text: str) -> tuple[str, str, str, str, str, str]:
    """What the token ``move`` holds: instruction, point, speed, zone, tool and work object."""
    match = _MOVE.fullmatch(text)
    assert match is not None  # both patterns are made of the same parts
    name, target, speed, zone, tool, work = match.groups()
    return name, target, speed, zone, tool, work


def show_token(token: Token) -> str:
    """A token for a message, short and on one line."""
    return "the end of the file" if token[0] == "end" else ascii(token[1][:40])


# RAPID text as a tree: modules, data, routines, statements and values. Lines are 1-based.

Numbers = tuple[float, ...]


class Ref(Struct, frozen=True, gc=False):
    """A name used as a value."""

    name: str


class Point(Struct, frozen=True, gc=False):
    """A robtarget written out: its numbers, grouped as the manual groups them."""

    value: tuple[Numbers, ...]


class Call(Struct, frozen=True, eq=False, gc=False):
    """A statement, or a function inside one: name in lower case, arguments in order, optional arguments by name."""

    line: int
    name: str
    args: tuple[Expr, ...] = ()
    options: tuple[tuple[str, Expr | None], ...] = ()


Expr = float | bool | str | tuple["Expr", ...] | Ref | Point | Call


class Shape(Struct, frozen=True, eq=False, gc=False):
    """What statements have in common that differ in the positions and orientations of their points only.

    name, args, options: as in Call, without the points, which come first. points: for each its configuration and
    external axes. lead, lines: line ends before the name and before the semicolon, from the statement before on.
    """

    name: str
    points: tuple[tuple[Numbers, ...], ...]
    args: tuple[Expr, ...]
    options: tuple[tuple[str, Expr | None], ...]
    lead: int
    lines: int


class Inline(Struct, frozen=True, eq=False, gc=False):
    """A motion to a point written out, through another one if its shape has two: a Call in a few bytes.

    to, via: positions. turn, via_turn: quaternions, as written.
    """

    line: int
    shape: Shape
    to: Vec3
    turn: Numbers
    via: Vec3 | None = None
    via_turn: Numbers = ()

    def call(self) -> Call:
        """The same motion as a statement like any other."""
        ends = ((self.to, self.turn),) if self.via is None else ((self.via, self.via_turn), (self.to, self.turn))
        points = (Point((*end, *rest)) for end, rest in zip(ends, self.shape.points, strict=True))
        return Call(self.line, self.shape.name, (*points, *self.shape.args), self.shape.options)


class Data(Struct, frozen=True, eq=False, gc=False):
    """A declaration. storage: const, pers or var. task: of TASK PERS."""

    line: int
    storage: str
    type: str
    name: str
    local: bool
    value: Expr | None
    task: bool = False


class Routine(Struct, frozen=True, eq=False, gc=False):
    """A PROC without parameters. handler: the statements behind ERROR, None where there is no such clause."""

    line: int
    name: str
    local: bool
    data: tuple[Data, ...]
    body: tuple[Call | Inline, ...]
    handler: tuple[Call | Inline, ...] | None = None


class Module(Struct, frozen=True, eq=False, gc=False):
    """A module with what it declares."""

    line: int
    name: str
    data: tuple[Data, ...]
    routines: tuple[Routine, ...]


@lru_cache(maxsize=1000)
def refs(*names: str) -> tuple[Ref, ...]:
    """Names as arguments; the same ones are shared by the many motions that have them."""
    return tuple(Ref(name) for name in names)


@lru_cache(maxsize=1000)
def work_object(name: str) -> tuple[tuple[str, Expr | None], ...]:
    """The optional argument WObj, shared in the same way."""
    return (("wobj", Ref(name)),)


# RAPID tokens as calls with their values: the grammar of a statement (RAPID kernel manual, grammar).

_DEEPEST = 12


class Calls:
    """Recursive descent with one token of look-ahead."""

    source: Iterator[Token]

    def __init__(self, text: str, line: int, start: int = 0) -> None:
        self.text = text
        self.token: Token = ("end", "", line, start)
        self.jump(start, line)

    # -- tokens --------------------------------------------------------------------------------------------------

    def take(self) -> Token:
        """The current token; the next one becomes current. The end stays the end."""
        token = self.token
        self.token = next(self.source, ("end", "", token[2], token[3]))
        return token

    def word(self) -> str:
        """The current name in lower case, or nothing."""
        return self.token[1].lower() if self.token[0] == "name" else ""

    def accept(self, mark: str) -> bool:
        """Takes ``mark`` if it is next."""
        if self.token[0] == "mark" and self.token[1] == mark:
            self.take()
            return True
        return False

    def expect(self, mark: str) -> None:
        """Takes ``mark`` or raises Wrong."""
        if not self.accept(mark):
            raise Wrong(self.token[2], f"{mark} expected, found {show_token(self.token)}")

    def name(self, what: str) -> str:
        """Takes a name that is no reserved word."""
        kind, text, line, _ = self.token
        if kind != "name" or text.lower() in RESERVED:
            raise Wrong(line, f"{what} expected, found {show_token(self.token)}")
        self.take()
        return text

    def jump(self, start: int, line: int) -> None:
        """Goes on at the offset ``start``, in ``line``: the end of a statement or the start of a token."""
        self.source = tokens(self.text, line, start)
        self.take()

    # -- statements ----------------------------------------------------------------------------------------------

    def statement_call(self) -> Call:
        """A statement that begins with a name, which is no reserved word, or is a whole motion."""
        kind, text, line, _ = self.take()
        if kind == "move":
            name, target, speed, zone, tool, work = whole_move(text)
            args: tuple[Expr, ...] = (Point(point(target, line)), *refs(speed, zone, tool))
            return Call(line, name.lower(), args, work_object(work))
        if self.token[0] == "mark" and self.token[1] in (":=", ":", ".", "{", "("):
            raise Wrong(line, f"{text}{self.token[1]} is a statement that is not read")
        if self.accept(";"):
            return Call(line, text.lower())
        arguments, options = self.arguments(0)
        self.expect(";")
        return Call(line, text.lower(), arguments, options)

    # -- expressions ---------------------------------------------------------------------------------------------

    def arguments(self, depth: int) -> tuple[tuple[Expr, ...], tuple[tuple[str, Expr | None], ...]]:
        """Arguments up to what is none, optional ones (after a backslash) apart."""
        args: list[Expr] = []
        options: list[tuple[str, Expr | None]] = []
        while True:
            if self.accept("\\"):
                name = self.name("the name of an optional argument").lower()
                options.append((name, self.expression(depth) if self.accept(":=") else None))
            else:
                args.append(self.expression(depth))
            if not self.accept(",") and self.token[1] != "\\":
                return tuple(args), tuple(options)

    def expression(self, depth: int = 0) -> Expr:
        """A value: written out, an aggregate, a name or a function."""
        token = self.token
        kind, text, line, _ = token
        if depth > _DEEPEST:
            raise Wrong(line, "an expression nested too deeply")
        if kind in ("number", "string", "point"):
            self.take()
            if kind == "number":
                return number(text, line)
            return Point(point(text, line)) if kind == "point" else string(text, line)
        if kind == "name":
            return self.named(depth)
        self.take()
        if text == "[":
            items = [self.expression(depth + 1)]
            while self.accept(","):
                items.append(self.expression(depth + 1))
            self.expect("]")
            return tuple(items)
        if text in ("+", "-") and self.token[0] == "number":
            return number(text + self.take()[1], line)
        raise Wrong(line, f"a value expected, found {show_token(token)}")

    def named(self, depth: int) -> Expr:
        """A name, TRUE, FALSE or a function with its arguments."""
        line = self.token[2]
        if self.word() in ("true", "false"):
            return self.take()[1].lower() == "true"
        name = self.name("a value")
        if not self.accept("("):
            return Ref(name)
        args, options = self.arguments(depth + 1)
        self.expect(")")
        return Call(line, name.lower(), args, options)


# Statements in the usual spelling, read at once: what long programs consist of.

#: Longer statements go the long way, so that a text without semicolons is not searched over and over.
_LONGEST = 1000
#: Position and orientation of a point. So few digits cannot make a number that is larger than a num can be.
_POINT_PLAIN = re.compile(r"\[\[([-.0-9,]{5,38})\],\[([-.0-9,]{7,100})\]")
_ANY_POINT = "[[0,0,0],[1,0,0,0]"
_MOST_POINTS = 2
#: Pieces of a statement with one point: before it, its position, its orientation, after it.
_PIECES_OF_ONE_POINT = 4
_REMARK = re.compile(r"[ \t\f\v\n]*![^\n]*\n")


def read_plain(text: str, start: int, line: int, body: list[Call | Inline]) -> tuple[int, int]:
    """Reads statements from the offset ``start``, in ``line``, up to one in no usual spelling; returns where that is.

    start: where a statement may begin, which is not before a reserved word.
    """
    while end := text.find(";", start, start + _LONGEST) + 1:
        statement = text[start:end]
        if "!" in statement:
            remark = _REMARK.match(text, start)
            if remark is None:
                break
            start = remark.end()
            line += remark[0].count("\n")
            continue
        cut = _POINT_PLAIN.split(statement)
        shape = _shape(*cut[::3])
        if shape is None:
            break
        try:
            body.append(_item(shape, line, cut))
        except ValueError:  # not three and four numbers
            break
        start = end
        line += shape.lines
    return start, line


def _item(shape: Shape, line: int, cut: list[str]) -> Call | Inline:
    """The statement of a shape with its own line and numbers. ValueError when they are none."""
    line += shape.lead
    if len(cut) == 1:
        return Call(line, shape.name, shape.args, shape.options)
    x, y, z = map(float, cut[-3].split(","))
    if len(cut) == _PIECES_OF_ONE_POINT:
        return Inline(line, shape, (x, y, z), _turn(cut[-2]))
    u, v, w = map(float, cut[1].split(","))
    return Inline(line, shape, (x, y, z), _turn(cut[-2]), (u, v, w), _turn(cut[2]))


@lru_cache(maxsize=1000)
def _turn(text: str) -> tuple[float, float, float, float]:
    """A quaternion: the same for many points."""
    w, x, y, z = map(float, text.split(","))
    if max(map(abs, (w, x, y, z))) > LARGEST:
        raise ValueError(text)
    return w, x, y, z


@lru_cache(maxsize=2000)
def _shape(*parts: str) -> Shape | None:
    """The shape of a statement that has points between ``parts``; nothing if the general rules are needed for it.

    A string may hold a semicolon, a function remembers its line, and a point that is not cut out has two brackets.
    """
    text, points = _ANY_POINT.join(parts), len(parts) - 1
    if points > _MOST_POINTS or any(mark in part for part in parts for mark in ('"', "(", "[[")):
        return None
    parser = Calls(text, 0)
    if parser.token[0] not in ("name", "move") or parser.word() in RESERVED:
        return None
    try:
        call = parser.statement_call()
    except Wrong:
        return None
    found = [arg.value[2:] for arg in call.args[:points] if isinstance(arg, Point)]
    if len(found) < points:
        return None
    return Shape(call.name, tuple(found), call.args[points:], call.options, call.line, text.count("\n"))


# RAPID tokens as modules, data and statements: the grammar of the read-back.

#: Words at which a statement that lost its semicolon must have ended.
_STRUCTURE = frozenset(("module", "endmodule", "proc", "endproc", "func", "endfunc", "trap", "endtrap"))
#: Words that only continue or close a control statement whose opening has been reported.
_CONTINUES = frozenset(("else", "elseif", "endif", "endfor", "endwhile", "endtest", "case", "default", "then", "do"))
#: Words with which a statement begins that is read in ERROR handlers alone.
_HANDLES = frozenset(("if", "raise", "exit"))
#: The name of the statement ``IF FCIsForceMode() FCDeact;``, one that no routine has.
DEACT_WHERE_ON = "if fcdeact"
#: The only IF that is read outside of them.
_ASKS = re.compile(r"if\s+FCIsForceMode\b", re.IGNORECASE)
_DATA = frozenset(("local", "task", "const", "pers", "var"))


def parse(text: str, first_line: int, plain: bool) -> tuple[list[Module], list[Fault]]:
    """The modules of one file whose first line has the number ``first_line``, and what is wrong with its grammar.

    plain: whether statements in the usual spelling are read at once.
    """
    parser = _Parser(text, first_line, plain)
    modules = parser.modules()
    return modules, parser.faults


class _Parser(Calls):
    """Modules and routines."""

    def __init__(self, text: str, first_line: int, plain: bool) -> None:
        start = banner(text)
        super().__init__(text, first_line + text.count("\n", 0, start), start)
        self.plain, self.first_line = plain, first_line
        self.faults: list[Fault] = []
        found = [one.strip() for one in text[:start].strip().split("\n")]
        if start and found != _BANNER_LINES:
            self.faults.append(Remark(first_line, f"a banner other than {' / '.join(_BANNER_LINES)}"))
        self.outside = start

    def recover(self) -> None:
        """Skips behind the next semicolon, but never over a word that opens or closes a routine or module."""
        while self.token[0] != "end" and self.word() not in _STRUCTURE:
            if self.ended():
                return

    def ended(self) -> bool:
        """Takes a token and says whether a statement ends with it."""
        kind, text, _, _ = self.take()
        return kind == "move" or text == ";"

    # -- modules -------------------------------------------------------------------------------------------------

    def modules(self) -> list[Module]:
        """All modules up to the end of the text."""
        found = []
        while self.token[0] != "end":
            if self.word() == "module":
                self.remark_comment()
                found.append(self.module())
            else:
                self.faults.append(Fault(self.token[2], f"{show_token(self.token)} stands outside a module"))
                while self.token[0] != "end" and self.word() != "module":
                    self.take()
        self.remark_comment()
        return found

    def remark_comment(self) -> None:
        """Notes a comment between modules: it is an element of a list inside of one (RAPID kernel manual, comments)."""
        end = self.token[3] if self.token[0] != "end" else len(self.text)
        comment = self.text.find("!", self.outside, end)
        if comment >= 0:
            line = self.first_line + self.text.count("\n", 0, comment)
            self.faults.append(Remark(line, "a comment outside of a module, where the kernel manual has none"))

    def module(self) -> Module:
        line = self.take()[2]
        name = ""
        try:
            name = self.name("a module name")
            if self.accept("("):
                while not self.accept(")"):
                    if self.take()[0] == "end":
                        raise Wrong(line, ") of the module's attributes is missing")
        except Wrong as wrong:
            self.faults.append(wrong.fault)
        data: list[Data] = []
        routines: list[Routine] = []
        while self.word() != "endmodule":
            if self.token[0] == "end" or self.word() == "module":
                self.faults.append(Fault(self.token[2], f"ENDMODULE of {name} is missing"))
                return Module(line, name, tuple(data), tuple(routines))
            try:
                self.member(data, routines)
            except Wrong as wrong:
                self.faults.append(wrong.fault)
                self.recover()
        self.outside = self.token[3] + len("endmodule")
        self.take()
        return Module(line, name, tuple(data), tuple(routines))

    def member(self, data: list[Data], routines: list[Routine]) -> None:
        """One declaration of a module."""
        line = self.token[2]
        local = task = False
        if self.word() in ("local", "task"):
            local, task = self.word() == "local", self.word() == "task"
            self.take()
        word = self.word()
        if word in ("const", "pers", "var"):
            if routines:
                self.faults.append(Fault(line, f"{word.upper()} after the first routine of the module"))
            data.append(self.data(line, local, task))
        elif word == "proc":
            self.take()
            routines.append(self.routine(line, local))
        elif word in ("func", "trap"):
            self.take()
            self.skip_past(f"end{word}")
            raise Wrong(line, f"{word.upper()} is not read")
        else:
            what = show_token(self.take())
            raise Wrong(line, f"a declaration expected, found {what}")

    def skip_past(self, word: str) -> None:
        """Skips a routine that is not read."""
        while self.token[0] != "end" and self.word() not in (word, "endmodule"):
            self.take()
        if self.word() == word:
            self.take()

    def data(self, line: int, local: bool, task: bool) -> Data:
        storage = self.take()[1].lower()
        data_type = self.name("a data type").lower()
        name = self.name(f"the name of a {data_type}")
        if self.accept("{"):
            raise Wrong(line, f"the array {name} is not read")
        value = self.expression() if self.accept(":=") else None
        self.expect(";")
        if value is None and (storage == "const" or (storage == "pers" and (local or task))):
            raise Wrong(line, f"{name} has no value")
        if storage == "pers" and not _literal(value):
            raise Wrong(line, f"PERS {name} must have a literal value")
        return Data(line, storage, data_type, name, local, value, task)

    # -- routines ------------------------------------------------------------------------------------------------

    def routine(self, line: int, local: bool) -> Routine:
        name = self.name("the name of a PROC")
        self.expect("(")
        if not self.accept(")"):
            self.skip_past("endproc")
            raise Wrong(line, f"PROC {name} has parameters, which are not read")
        data: list[Data] = []
        body: list[Call | Inline] = []
        handler: list[Call | Inline] | None = None
        while self.word() != "endproc":
            if self.token[0] == "end" or self.word() in _STRUCTURE:
                self.faults.append(Fault(self.token[2], f"ENDPROC of {name} is missing"))
                return _routine(line, name, local, data, body, handler)
            try:
                if self.word() == "error" and handler is None:
                    self.take()
                    handler = []
                elif self.word() in _DATA:
                    data.append(self.routine_data(bool(body) or handler is not None))
                elif handler is not None and self.word() in _HANDLES:
                    handler.append(self.handling())
                elif handler is None and self.word() == "if" and _ASKS.match(self.text, self.token[3]):
                    body.append(self.handling())
                else:
                    self.statement(body if handler is None else handler)
            except Wrong as wrong:
                self.faults.append(wrong.fault)
                self.recover()
        self.take()
        return _routine(line, name, local, data, body, handler)

    def handling(self) -> Call:
        """The end of force control where it is on, and what only an ERROR handler may say here: RAISE, EXIT."""
        _, text, line, _ = self.take()
        if text.lower() == "if":
            for mark in ("fcisforcemode", "(", ")", "fcdeact"):
                if self.token[1].lower() != mark:
                    raise Wrong(line, "IF is read as IF FCIsForceMode() FCDeact; alone")
                self.take()
        self.expect(";")
        return Call(line, DEACT_WHERE_ON if text.lower() == "if" else text.lower())

    def routine_data(self, late: bool) -> Data:
        line = self.token[2]
        word = self.word()
        if word not in ("const", "var"):
            self.take()
            raise Wrong(line, f"{word.upper()} inside a routine")
        if late:
            self.take()
            raise Wrong(line, f"{word.upper()} after the first statement of a routine")
        return self.data(line, False, False)

    def statement(self, body: list[Call | Inline]) -> None:
        """One statement, or as many as can be read at once."""
        token = self.token
        kind, text, line, start = token
        if kind not in ("name", "move"):
            self.take()
            if text != ";":
                raise Wrong(line, f"a statement expected, found {show_token(token)}")
            self.faults.append(Remark(line, "an empty statement, which the kernel manual does not have"))
            return
        if text.lower() in RESERVED:
            self.control()
            return
        if self.plain:
            end, line = read_plain(self.text, start, line, body)
            if end != start:
                self.jump(end, line)
                return
        body.append(self.statement_call())

    def control(self) -> None:
        """Reports a control statement and skips its head, so that the statements inside it are still looked at."""
        word, line = self.word(), self.token[2]
        if word not in _CONTINUES:
            self.faults.append(Fault(line, f"{word.upper()} is a statement that is not read"))
        self.take()
        while self.token[0] != "end" and self.token[2] == line and self.word() not in _STRUCTURE:
            if self.word() in ("then", "do"):
                self.take()
                return
            if self.ended():
                return


def _routine(
    line: int,
    name: str,
    local: bool,
    data: Sequence[Data],
    body: Sequence[Call | Inline],
    handler: Sequence[Call | Inline] | None,
) -> Routine:
    return Routine(line, name, local, tuple(data), tuple(body), None if handler is None else tuple(handler))


def _literal(value: Expr | None) -> bool:
    if isinstance(value, tuple):
        return all(_literal(item) for item in value)
    return not isinstance(value, (Ref, Call))
