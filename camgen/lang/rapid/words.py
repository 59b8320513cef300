"""Names that a RAPID controller has, so that a program may not declare them.

Sources: RAPID overview, identifiers; the lists of data types, instructions and functions of the
RAPID reference manuals.
"""

from __future__ import annotations

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
