"""The reserved words of PacScript, and the rules of names (RC8 manual 449).

The words come from a published list.
"""

from __future__ import annotations

#: Maximum number of characters of a name.
_LONGEST = 64
#: Words of statements, of the flow of a program, of types and operators.
_STATEMENTS = """
    accel addhandler addpathpoint angulartrigger approach archmove arrive buzzer byref byval
    call callbyname case changetool changework clearareadetected clearservolog clrerr
    clrpathpoint cpmode createarray createmultiarray createmutex crtmotionallow date decel defio
    delay deletemutex depart dim do draw drive drivea else elseif encmotionallow
    encmotionallowjnt end eralw error exclusivearea exit extspeed for forcechangetable forcectrl
    forceparam forcesensor forcesensorpayload forcewaitcondition function givearm givemutex goto
    grvctrl grvoffset halt highpathaccuracy hold if interrupt keep kill killall killbyname let
    leta letf letj leto letp letr letrx letry letrz letx lety letz loadpathpoint loop motionskip
    motiontimeout motor move msgbox next on pagechange pagechangebyname payload printdbg
    printmsg public randomize rem removehandler reset resetarea resetexclusivearea resetmutex
    resume rotate rotateh run runbyname select set setarea setcollisiondetection
    setexclusivearea sethandio setpriority setpublicvalue singularavoid speed speedmode
    srvunlock startservolog static step stop stopservolog sub suspend suspendall suspendbyname
    takearm takemutex then to tool until wait waitmotion while work zforce"""
_TYPES = "integer single double string vector position joint trans variant byte bit"
_VALUES = "and as false is mod not off or true xor io ptp"
_FUNCTIONS = """
    abs acos area areapos areasize array asc asin atan atn atn2 avec bin ceil chr cos cross
    curacc curcpmode curdec curerr curexj curextacc curextdec curextspd curfig
    curforcesensorpayload curjnt curlmt curoptmode curpathpoint curpayload curpos curspd
    curspeedmode curtool curtrn curwork deadmanstate degrad destjnt destpos desttrn detecton
    detectoff dev devh dist dot dps errlvl errmsg exp extaccel extdecel fig fix forcevalue
    format getareadetected getcollisionstatus gethandio getlanguage getpathpoint
    getpathpointcount getpriority getpublicvalue getsrvdata getsrvjntdata hex instr instrrev int
    j2p j2t lbound lcase left len lenb lockstate log log10 ltrim magnitude max mid min
    motioncomplete motorstate mps mutexid mutexstate normalvector now ovec p2j p2t pallet posclr
    posrx posry posrz posx posy posz pow pvec raddeg realpath right rnd robinfo rpm rtrim rvec
    sgn sin sprintf sqr statusbyname str swapbytearray synctime sysinfo syslog sysstate t2j t2p
    takearmstate tan time timer tinv tmul tnorm toolpos ubound ucase val varchangetype vartype
    ver virtualfence vis workattribute workpos writebytearray readbytearray"""
RESERVED = frozenset(f"{_STATEMENTS} {_TYPES} {_VALUES} {_FUNCTIONS}".split())
STATEMENTS = frozenset(_STATEMENTS.split())


def name_fault(name: str) -> str:
    """Return the reason why a name is invalid, or an empty text."""
    if len(name) > _LONGEST:
        return f"the name {name[:20]}... is longer than {_LONGEST} characters"
    if name.lower() in RESERVED:
        return f"{name} is a word of the language"
    return ""
