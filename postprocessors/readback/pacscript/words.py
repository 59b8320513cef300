"""Names in PacScript: which ones the language keeps, how long they may be, and what a declared type can hold.

RC8 manual 449 (names), 450 (types); the words are those of a published keyword list.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from camgen.model.pose import Pose
from camgen.model.program import Joints

from .values import Either, Mps, Value, Vector

_LONGEST = 64
#: Words of statements, of the flow of a program, of types and operators.
_STATEMENTS = """
    accel addhandler addpathpoint angulartrigger approach archmove arrive buzzer byref byval call callbyname
    case changetool changework clearareadetected clearservolog clrerr clrpathpoint cpmode createarray
    createmultiarray createmutex crtmotionallow date decel defio delay deletemutex depart dim do draw drive
    drivea else elseif encmotionallow encmotionallowjnt end eralw error exclusivearea exit extspeed for
    forcechangetable forcectrl forceparam forcesensor forcesensorpayload forcewaitcondition function givearm
    givemutex goto grvctrl grvoffset halt highpathaccuracy hold if interrupt keep kill killall killbyname let
    leta letf letj leto letp letr letrx letry letrz letx lety letz loadpathpoint loop motionskip motiontimeout
    motor move msgbox next on pagechange pagechangebyname payload printdbg printmsg public randomize rem
    removehandler reset resetarea resetexclusivearea resetmutex resume rotate rotateh run runbyname select set
    setarea setcollisiondetection setexclusivearea sethandio setpriority setpublicvalue singularavoid speed
    speedmode srvunlock startservolog static step stop stopservolog sub suspend suspendall suspendbyname takearm
    takemutex then to tool until wait waitmotion while work zforce"""
_TYPES = "integer single double string vector position joint trans variant byte bit"
_VALUES = "and as false is mod not off or true xor io ptp"
_FUNCTIONS = """
    abs acos area areapos areasize array asc asin atan atn atn2 avec bin ceil chr cos cross curacc curcpmode
    curdec curerr curexj curextacc curextdec curextspd curfig curforcesensorpayload curjnt curlmt curoptmode
    curpathpoint curpayload curpos curspd curspeedmode curtool curtrn curwork deadmanstate degrad destjnt
    destpos desttrn detecton detectoff dev devh dist dot dps errlvl errmsg exp extaccel extdecel fig fix
    forcevalue format getareadetected getcollisionstatus gethandio getlanguage getpathpoint getpathpointcount
    getpriority getpublicvalue getsrvdata getsrvjntdata hex instr instrrev int j2p j2t lbound lcase left len
    lenb lockstate log log10 ltrim magnitude max mid min motioncomplete motorstate mps mutexid mutexstate
    normalvector now ovec p2j p2t pallet posclr posrx posry posrz posx posy posz pow pvec raddeg realpath right
    rnd robinfo rpm rtrim rvec sgn sin sprintf sqr statusbyname str swapbytearray synctime sysinfo syslog
    sysstate t2j t2p takearmstate tan time timer tinv tmul tnorm toolpos ubound ucase val varchangetype vartype
    ver virtualfence vis workattribute workpos writebytearray readbytearray"""
RESERVED = frozenset(f"{_STATEMENTS} {_TYPES} {_VALUES} {_FUNCTIONS}".split())


def name_fault(name: str) -> str:
    """Why the language does not take a name that a text gives; empty when it does."""
    if len(name) > _LONGEST:
        return f"the name {name[:20]}... is longer than {_LONGEST} characters"
    if name.lower() in RESERVED:
        return f"{name} is a word of the language"
    return ""


def _is_whole(value: Value) -> bool:
    numbers = value.values if isinstance(value, Either) else (value,)
    return all(isinstance(one, float) and math.isfinite(one) and one == int(one) for one in numbers)


def _is_number(value: Value) -> bool:
    return isinstance(value, (float, Either, Mps))


def _is_position(value: Value) -> bool:
    return isinstance(value, Pose)


#: What a variable of each type holds as it is, lower case; a string holds nothing that is evaluated.
TYPES: dict[str, Callable[[Value], bool]] = {
    **dict.fromkeys(("integer", "byte", "bit"), _is_whole),
    **dict.fromkeys(("single", "double"), _is_number),
    **dict.fromkeys(("position", "trans"), _is_position),
    "vector": lambda value: isinstance(value, Vector),
    "joint": lambda value: isinstance(value, Joints),
    "string": lambda _: False,
    "variant": lambda _: True,
}
