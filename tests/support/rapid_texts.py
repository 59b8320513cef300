"""Random RAPID modules like those of a post, with a few unusual statements, and random changes."""

import re
from collections.abc import Callable
from random import Random

E9 = "[9E9,9E9,9E9,9E9,9E9,9E9]"
TOOL = "TASK PERS tooldata {}:=[TRUE,[[0,0,{}],[1,0,0,0]],[0.001,[0,0,0.001],[1,0,0,0],0,0,0]];\n"
WORK = 'TASK PERS wobjdata {}:=[FALSE,TRUE,"",[[{},0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n'
POINT = f"[[1,2,3],[0,1,0,0],[0,0,0,0],{E9}]"
START = f"ConfJ\\Off;ConfL\\Off;MoveAbsJ [[0,0,0,0,90,0],{E9}],v100,fine,t1;\n"
TAIL = "t1\\WObj:=w1;\n"

NUMBERS = ["0", "1", "2.5", "-3.125", "10.000", "-0.000", "7", "-12", "99.999"]
ODD_NUMBERS = [
    ".5",
    "5.",
    "+3",
    "1E1",
    "2e-1",
    "123456789012",
    "--1",
    "1.2.3",
    "",
    "-",
    "9E99",
    "1_0",
    " 4",
    "9" * 39,
]
TURNS = ["0,1,0,0", "1,0,0,0", "0.0000000,0.7071068,0.7071068,0.0000000", "0.6,0,-.8,0", "0,-0,1,0"]
ODD_TURNS = ["0,1,.1,0", "1,0,0", "1E0,0,0,0", "9" * 50 + ",0,0,0", "1,0,0,0,0", "1, 0,0,0"]
CALLS = ["sub1;", "sub1;sub2;", "sub1;sub2;sub3;", "Sub3;sub1;SUB2;"]
STATEMENTS = ["SetDO do1,1;", "SetDO do1,0;", "WaitTime 0.5;", "Reset do2;", "! a remark; x"]
ODD_STATEMENTS = [
    ";", 'TPWrite "a;b ! c";', "IF a THEN", "ENDIF", "x:=5;", "MoveAbsJ j1,v5,fine,t1;",
    "%%%\n VERSION:1\n%%%", f"MoveL p1,v100,z5,{TAIL}", "VAR num n;", "sub1 p1;",
    "MoveL Offs(p1,\n1),v5,fine,t1;", "FCCalib load0;", "ConfL\\Off;",
]  # fmt: skip
#: Statements with a point P in a place, or with other arguments, that the post does not write.
ODD_POINTS = [
    "SetDO P,1;", "MoveAbsJ P,v5,fine,t1;",
    f"MoveC p1,P,v5,fine,{TAIL}", f"MoveC P,p1,v5,fine,{TAIL}",
    f"MoveL P,v5\\V:=7,z5\\Z:=2,{TAIL}", f"movel P,[9,5,5,5],fine,{TAIL}",
    f"MoveC P,P,P,v5,fine,{TAIL}", f"MoveL P,P,v5,fine,{TAIL}",
    "MoveL P,v5,fine,t1\\WObj:=P;", f"MoveL Offs(P,1,0,\n0),vOwn,fine,{TAIL}",
    "MoveL P,v5,fine,t1;", f"FCPressC P,p1,v5,5,fine,{TAIL}",
    f"MoveC P,P,v5,fine,t1;MoveL P\n,v5,fine,{TAIL}",
]  # fmt: skip
MARKS = [
    *';!"()[],\\ \n9.-+E:',
    "[[",
    "]]",
    "\t",
    "\f",
    "\u00a0",
    "!x;\n",
    "\r\n",
    "ENDPROC\n",
    "1E3",
    "FCPressEnd",
]


def either(chance: Random, usual: list[str], odd: list[str]) -> str:
    """A random text of the usual ones; in 1 of 200 cases of the odd ones."""
    return chance.choice(odd if chance.random() < 0.005 else usual)


def point(chance: Random) -> str:
    xyz = ",".join(either(chance, NUMBERS, ODD_NUMBERS) for _ in range(3))
    conf = either(chance, ["0,0,0,0"] * 5 + ["-1,0,1,0"], ["0,0.5,0,0", "0,0,0"])
    rotation = either(chance, TURNS, ODD_TURNS)
    external = either(chance, [E9], [E9[:-5], "[0,0,0,0,0,0]"])
    return f"[[{xyz}],[{rotation}],[{conf}],{external}]"


def tail(chance: Random, force: str = "") -> str:
    speed = either(chance, ["v100", "v5", "vOwn"], ["v37", "fine", "V100", "vSub"])
    zone = either(chance, ["fine", "fine", "z5", "zOwn"], ["z3", "v5", "FINE"])
    tool, work_object = (
        either(chance, ["t1"], ["T1", "t2", "p1"]),
        either(chance, ["w1"], ["W1", "w2", "wobj0"]),
    )
    return f"{speed},{force}{zone},{tool}\\WObj:={work_object};"


def statement(chance: Random) -> str:
    """One or a few statements as a post writes them, rarely ones that no post writes."""
    split = chance.choice([",", ",\n        ", ", "])
    match chance.randrange(20):
        case 0 if chance.random() < 0.3:
            return chance.choice(ODD_STATEMENTS)
        case 0 | 10:
            statement_text = chance.choice(ODD_POINTS)
            return re.sub(
                "P(?=[,)\\];\n])",
                lambda _: point(chance),
                f"{statement_text}\n{statement_text}\n{statement_text}",
            )
        case 1 | 2 | 3:
            return chance.choice(STATEMENTS)
        case 4:
            start = f"FCPress1LStart {point(chance)}{split}v5,\\Fz:=5,50,fine,{TAIL}"
            lines = [
                f"FCPressL {point(chance)},{tail(chance, either(chance, ['5,', '7.5,'], ['-5,']))}"
                for _ in "123"
            ]
            lines[1] = f"FCPressC {point(chance)}{split}{point(chance)},{tail(chance, '5,')}"
            return start + "\n".join([*lines, f"FCPressEnd {point(chance)},v5,{TAIL}"])
        case 5 | 6 | 7 | 8 | 9:
            return f"MoveC {point(chance)}{split}{point(chance)},{tail(chance)}"
        case _:
            return f"Move{chance.choice('JLLLLL')} {point(chance)},{tail(chance)}"


def routine(chance: Random, name: str, speed: int) -> str:
    data = ["", f"CONST speeddata vSub:=[{speed},5,5,5];\n", "CONST speeddata v5:=[1,5,5,5];\n"]
    head = START if name == "main" else chance.choice(data)
    lines = "\n".join(statement(chance) for _ in range(chance.randrange(12)))
    if name == "main":
        lines += "\n" + chance.choice(CALLS) + "\n" + statement(chance)
    return f"PROC {name}()\n{head}{lines}\nENDPROC\n"


def program(chance: Random) -> list[str]:
    """Modules with frames, data of equal names, and routines that may be called or not."""
    texts = []
    for k in range(chance.choice([1, 1, 2, 3])):
        local = chance.choice(["", "LOCAL "])
        declarations = f"{local}CONST speeddata vOwn:=[{20 + k},500,5000,1000];\n"
        declarations += f"{local}CONST robtarget p1:={POINT};\n"
        declarations += f"LOCAL CONST zonedata zOwn:=[FALSE,{2 + k},3,3,1,3,1];\n"
        if k == 0 or chance.random() < 0.1:
            declarations += TOOL.format("t1", 9 + k) + WORK.format("w1", 100 + k)
        names = ["main", "sub1"] if k == 0 else [f"sub{k + 1}", chance.choice(["sub1", "spare"])]
        routines = "".join(
            (local if name == "sub1" else "") + routine(chance, name, 30 + k) for name in names
        )
        texts.append(f"MODULE m{k}\n{declarations}{routines}ENDMODULE\n")
    return texts


# Changes


def _delete_characters(chance: Random, text: str) -> str:
    place = chance.randrange(len(text))
    return text[:place] + text[place + chance.choice([1, 1, 2, 30]) :]


def _insert_mark(chance: Random, text: str) -> str:
    place = chance.randrange(len(text))
    return text[:place] + chance.choice(MARKS) + text[place + chance.randrange(2) :]


def _insert_break(chance: Random, text: str) -> str:
    """The text with a line end or a remark between two tokens."""
    place = chance.choice([match.start() for match in re.finditer(r"[,;\[\]\\ \n]", text)] or [0])
    return (
        text[:place] + chance.choice(["\n", "\n\n  ", " ", "! r; [[1,2,3]\n", "\r"]) + text[place:]
    )


def _move_line(chance: Random, text: str) -> str:
    lines = text.splitlines(keepends=True)
    line = lines.pop(chance.randrange(len(lines)))
    if chance.random() < 0.7:
        lines.insert(chance.randrange(len(lines) + 1), line * chance.choice([1, 2]))
    return "".join(lines)


def _rename(chance: Random, text: str) -> str:
    names = re.findall(r"\b[A-Za-z]\w*", text) or ["x"]
    old, new = chance.choice(names), chance.choice(names)
    return re.sub(rf"\b{old}\b", lambda _: new, text, count=chance.choice([0, 1, 5]))


_CHANGES: list[Callable[[Random, str], str]] = [
    _delete_characters,
    _insert_mark,
    _insert_break,
    _move_line,
    _rename,
]


def changed(chance: Random, text: str) -> str:
    """The text with one change."""
    return chance.choice(_CHANGES)(chance, text) or " "
