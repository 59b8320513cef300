"""RAPID data types and predefined data, in mm, deg, mm/s and kg.

Source: the system data types manual, for the values its chapters speeddata and zonedata.
"""

from __future__ import annotations

Value = float | bool | str | tuple["Value", ...]

_XYZ = (("x", "num"), ("y", "num"), ("z", "num"))
_POSE = (("trans", "pos"), ("rot", "orient"))
#: Components of the record types, name and type of each.
TYPES: dict[str, tuple[tuple[str, str], ...]] = {
    "pos": _XYZ,
    "orient": (("q1", "num"), ("q2", "num"), ("q3", "num"), ("q4", "num")),
    "pose": _POSE,
    "confdata": (("cf1", "num"), ("cf4", "num"), ("cf6", "num"), ("cfx", "num")),
    "robjoint": tuple((f"rax_{i}", "num") for i in range(1, 7)),
    "extjoint": tuple((f"eax_{c}", "num") for c in "abcdef"),
    "robtarget": (*_POSE, ("robconf", "confdata"), ("extax", "extjoint")),
    "jointtarget": (("robax", "robjoint"), ("extax", "extjoint")),
    "speeddata": (("v_tcp", "num"), ("v_ori", "num"), ("v_leax", "num"), ("v_reax", "num")),
    "zonedata": (
        ("finep", "bool"),
        *(
            (n, "num")
            for n in ("pzone_tcp", "pzone_ori", "pzone_eax", "zone_ori", "zone_leax", "zone_reax")
        ),
    ),
    "loaddata": (
        ("mass", "num"),
        ("cog", "pos"),
        ("aom", "orient"),
        ("ix", "num"),
        ("iy", "num"),
        ("iz", "num"),
    ),
    "tooldata": (("robhold", "bool"), ("tframe", "pose"), ("tload", "loaddata")),
    "wobjdata": (
        ("robhold", "bool"),
        ("ufprog", "bool"),
        ("ufmec", "string"),
        ("uframe", "pose"),
        ("oframe", "pose"),
    ),
}
#: Types of values that are not records.
LITERAL = {"num": float, "bool": bool, "string": str}
#: Value of an external axis that does not exist.
UNUSED = 9e9
NO_TURN = (1.0, 0.0, 0.0, 0.0)
_ZERO = (0.0, 0.0, 0.0)
IDENTITY = (_ZERO, NO_TURN)

_SPEEDS = (5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800,
           1000, 1500, 2000, 2500, 3000, 4000, 5000, 6000, 7000)  # fmt: skip
#: mm: radius of a zone for the TCP. The other components do not change the path of the TCP.
_ZONES = {"z0": 0.3} | {
    f"z{r}": float(r) for r in (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)
}
PREDEFINED: dict[str, tuple[str, Value]] = (
    {f"v{v}": ("speeddata", (float(v), 500.0, 5000.0, 1000.0)) for v in _SPEEDS}
    | {name: ("zonedata", (False, r, r, r, r, r, r)) for name, r in _ZONES.items()}
    | {
        "fine": ("zonedata", (True, *(0.0,) * 6)),
        "high": ("num", 1.0),
        "low": ("num", 0.0),
        "tool0": ("tooldata", (True, IDENTITY, (0.001, (0.0, 0.0, 0.001), NO_TURN, 0.0, 0.0, 0.0))),
        "wobj0": ("wobjdata", (False, True, "", IDENTITY, IDENTITY)),
    }
)


#: System modules of older controllers, and their names (RAPID overview, system modules).
RESIDENT = frozenset(
    "base user wobj1 reg1 reg2 reg3 reg4 reg5 clock1 high low edge".split()  # noqa: SIM905
)

#: Further record types, which posts do not write.
MORE_TYPES: dict[str, tuple[tuple[str, str], ...]] = {
    "stoppointdata": (
        ("type", "num"), ("progsynch", "bool"), ("inpos", "inposdata"), ("stoptime", "num"),
        ("followtime", "num"), ("signal", "string"), ("relation", "num"), ("checkvalue", "num"),
    ),
    "inposdata": (("position", "num"), ("speed", "num"), ("mintime", "num"), ("maxtime", "num")),
    "tasks": (("taskname", "string"),),
    "confsupdata": (),
    "progdisp": (("pdisp", "pose"), ("eoffs", "extjoint")),
}  # fmt: skip
#: Data types whose values are numbers.
NUMBERS = frozenset(
    """num dnum byte intnum errnum errdomain errtype dionum opnum symnum tpnum triggflag stoppoint
    icondata buttondata handler_type""".split()  # noqa: SIM905
)
#: Data types whose values are texts.
TEXTS = frozenset(("string", "mecunit", "errstr", "taskid"))
#: Further predefined data. Values that depend on the robot are usual ones.
MORE: dict[str, tuple[str, Value]] = {
    "vmax": ("speeddata", (5000.0, 500.0, 5000.0, 1000.0)),
    "load0": ("loaddata", (0.001, (0.0, 0.0, 0.001), NO_TURN, 0.0, 0.0, 0.0)),
    "pi": ("num", 3.1415927),
    "stempty": ("string", ""),
    "edge": ("num", 2.0),
    "diskhome": ("string", "HOME:"),
    **{
        name: ("num", float(k))
        for k, name in enumerate(("op_undef", "op_auto", "op_man_prog", "op_man_test"))
    },
    **{
        name: ("num", float(k))
        for k, name in enumerate(("run_undef", "run_cont_cycle", "run_instr_fwd"))
    },
    **{f"vrot{v}": ("speeddata", (0.01, 0.01, 0.01, float(v))) for v in (1, 2, 5, 10, 20, 50, 100)},
    **{
        f"vlin{v}": ("speeddata", (0.01, 0.01, float(v), 0.01))
        for v in (10, 20, 50, 100, 200, 500, 1000)
    },
}
#: Variables of the system module `user` of older controllers, with their types.
USER = {**{f"reg{k}": "num" for k in range(1, 6)}, "clock1": "clock", "wobj1": "wobjdata"}

# Names that a RAPID controller has, so that a program may not declare them (RAPID overview,
# identifiers; the lists of data types, instructions and functions of the RAPID reference manuals).
_DATA_TYPES = """
    bool byte clock confdata confsupdata corrdescr dionum dnum errnum errstr extjoint icondata
    identno intnum iodev jointtarget loaddata mecunit motsetdata num opnum orient paridnum pos
    pose progdisp rawbytes robjoint robtarget shapedata signalai signalao signaldi signaldo
    signalgi signalgo singdata socketdev speeddata stoppoint stoppointdata string switch symnum
    taskid tooldata tpnum triggdata trapdata uishownum wobjdata wztemporary wzstationary
    zonedata"""
_INSTRUCTIONS = """
    accset actunit add break callbyvar circlepathmode cirpathmode clear clkreset clkstart
    clkstop close confj confl connect corrclear corrcon corrwrite deactunit decr eoffsoff
    eoffson eoffsset erase errwrite excel fcact fccalib fcdeact fcpress1lstart fcpressc
    fcpressend fcpressl fcspdchgact fcspdchgdeact fcsupvforce gripload idelete idisable ienable
    incr invertdo isignalai isignaldi isignaldo isleep itimer iwatch load motionsup moveabsj
    movec movecdo movecsync moveext movej movejdo movejsync movel moveldo movelsync open
    pathacclim pathresol pdispoff pdispon pdispset proccall pulsedo read reset restopath return
    rewind save searchc searchl set setao setdo setgo singarea softact softdeact speedrefresh
    startmove stop stopmove storepath tpclr tperase tpreadfk tpreadnum tpshow tpwrite triggc
    triggcheckio triggequip triggint triggio triggj triggl triggspeed uimsgbox unload velset
    waitdi waitdo waittime waituntil waitwobj write writestrbin wzboxdef wzdisable wzenable"""
_FUNCTIONS = """
    abs acos argname asin atan atan2 bitand bitor bitxor bittobyte bytetostr calcjointt calcrobt
    cdate cjointt clkread corrread cos cpos crobt ctime ctool cwobj defdframe defframe dim
    distance doutput dotprod eulerzyx exp fcisforcemode fcloadid gettime goutput indpos mirpos
    norient offs oporient ord orientzyx posemult poseinv posevect pow present readbin readmotor
    readnum readstr reltool robos round sin sqrt strfind strlen strmap strmatch strmemb strorder
    strpart strtobyte strtoval tan testdi trunc validio valtostr vectmagn"""
_VALUES = "diskhome disktemp home load0 pi tool0 vmax wobj0 stempty"

INSTALLED = frozenset(f"{_DATA_TYPES} {_INSTRUCTIONS} {_FUNCTIONS} {_VALUES}".split())
