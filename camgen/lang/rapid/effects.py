"""RAPID's instructions without a motion in the translation: by word, the reason or the effect.

Every instruction of the technical reference manual that `instructions.py` does not carry out stands
in one of these tables. `SILENT`: it moves and switches nothing, for a reason. `OMITTED`: it changes
how a program runs, and another machine runs without it; a build says so, and `--strict` refuses.
`LOST`: another machine would move differently; a build is refused. `OPTIONS`: arguments of motions.
"""

from __future__ import annotations

from camgen.lang.word_tables import by_word

SILENT = by_word({
    "a screen, a log or the pendant": """
        consolewrite cornerpathwarning errlog errwrite recoverymenu recoverymenuwr skipwarn tperase
        tpshow tpwrite uimsgwrite uimsgwriteabort uishow""",
    "a camera; what it sees is asked for where it is used": """
        aliascamera camflush camloadjob camreqimage camsetexposure camsetparameter
        camsetprogrammode camsetrunmode camstartloadjob camwaitloadjob""",
    "a file, a socket or a queue": """
        clearrawbytes cleariobuff close closedir copyfile copyrawbytes makedir open opendir
        packdnheader packrawbytes removedir removefile renamefile rewind rmqemptyqueue rmqfindslot
        rmqsendmessage rmqsendwait save savecfgdata scwrite siclose siconnect sisetcyclic
        socketaccept socketbind socketclose socketconnect socketcreate socketlisten socketsend
        socketsendto texttabinstall uiclientexist write writeanybin writebin writeblock writecfgdata
        writerawbytes writestrbin writevar writevararr""",
    "a clock or a count": """
        clkreset clkstart clkstop pathlengthreset pathlengthstart pathlengthstop resetaxisdistance
        resetaxismovetime resetmaxusagetime resetretrycount resettorquemargin spystart spystop
        testsigndefine testsignreset""",
    "a module of the program: its routines are those of the files": """
        cancelload checkprogref erasemodule load startload unload""",
    "a zone or a limit that is only declared": """
        wzboxdef wzcyldef wzhomejointdef wzlimjointdef wzsphdef""",
    "a supervision, which stops an arm at a fault": """
        initsuperv removeallcyclicbool removecyclicbool removesuperv resetppmoved
        safetycontrollersyncrequest setupcyclicbool setupsuperv settmsignal triggstopproc tryint
        fcsupvforce fcsupvorient fcsupvpos fcsupvreorispeed fcsupvtcpspeed fcsupvtorque""",
    "a record of motions or of a sensor": """
        loadprofile pathrecstart pathrecstop prxdbgstorerecord prxresetrecords
        prxsetrecordsampletime prxstartrecord prxstoprecord prxstorerecord recordprofile
        recoveryposreset recoveryposset storeprofile""",
    "a declaration of data, without an effect by itself": """
        capsetstopmode dadefextsig dadefprocdata dadefprocsig dadefuserdata dasetcurrdata
        dasetupappbehav egmactjoint egmactpose egmgetid egmreset egmsetupai egmsetupao egmsetupgi
        egmsetupltapp egmsetupuc egmstop egmstreamstart egmstreamstop fccalib fccondforce
        fccondorient fccondpos fccondreorispeed fccondtcpspeed fccondtorque fricidinit hand_seterror
        setdatasearch triggdatacopy triggdatareset""",
})  # fmt: skip

OMITTED = by_word({
    "accelerations": "accset pathacclim worldacclim",
    "the speed while the program runs": "speedlimaxis speedlimcheckpoint speedrefresh",
    "the configuration of the axes on the way": """
        confj confl hollowwristreset singarea usereachabletargets""",
    "the tuning of the motion": """
        fcresetdampingtune fcresetlpfiltertune fcsetdampingtune fcsetlpfiltertune
        fricidsetfriclevels motionprocessmodeset pathresol tunereset tuneservo""",
    "the load": "gripload mechunitload",
    "the tool of the system": "recalctcp setsysdata",
    "corrections of a path, without one by itself": """
        corrclear corrcon corrdiscon ditheract ditherdeact egmactmove""",
    "the end of a soft servo": "cssdeact cssforceoffsetdeact softdeact",
    "external axes": """
        actunit deactunit eoffsoff eoffson eoffsset indgunmovereset indreset ioctrlaxis_refsync
        ioctrlaxis_refsyncoff ioctrlaxis_refsyncon stcalib stindgunreset sttune sttunereset""",
    "a stop of the motion, and its going on": """
        brakecheck clearpath cyclicbrakecheck procerrrecovery restopath startmove startmoveretry
        stopmove stopmovereset storepath""",
    "a wait, which is over at once": "waitandrecprof waitload waittestandset",
    "when events happen on a path": "acteventbuffer deacteventbuffer",
    "outputs or stops by the place of the tool": """
        capcondsetdo motionsup wzdisable wzdoset wzenable wzfree wzlimsup""",
    "which signals there are": "aliasio aliasioreset iobusstart iodisable ioenable",
    "the process or the gripper": """
        arckill arcrefresh arcrepl capaptrsetup capaptrsetupai capaptrsetupao capaptrsetuppers
        capequidist caplatrsetup capnoprocess caprefresh capweavesync daactproc dadeactallproc
        dadeactproc dastartmanaction hand_domotorcalibration hand_gripinward hand_gripoutward
        hand_initialize hand_joginward hand_jogoutward hand_moveto hand_stop ipssetparam setbrush
        setbrushfac""",
})  # fmt: skip

LOST = by_word({
    "the robot follows a conveyor or a sensor; take it out, or teach the path at rest": """
        activateprofile cnvgeninstr cnvpredictreach cnvsync deactprofile dropsensor dropwobj
        indcnvaddobject indcnvdisable indcnvenable indcnvinit indcnvreset prxactivandstorerecord
        prxactivrecord prxdeactrecord prxresetpos prxsetposoffset prxsetsyncalarm prxusefilerecord
        supsyncsensoroff supsyncsensoron synctosensor syncwwobj waitsensor waitwobj""",
    "several robots move in step; give each a program of its own": """
        syncmoveoff syncmoveon syncmoveresume syncmovesuspend syncmoveundo waitsynctask""",
    "a sensor corrects the path; teach the corrected path": "corrwrite",
    "the servo is soft, so that the arm gives way; another arm would press": """
        cssact cssforceoffsetact cssoffsettune softact softelbow""",
    "force control moves the arm; another arm needs a program of its own": """
        fcact fccondwaitwhile fcrefcircle fcrefforce fcrefline fcrefmoveframe fcrefrot fcrefspiral
        fcrefsprforcecart fcrefstop fcreftorque fcspdchgact fcspdchgdeact fcspdchgtunreset
        fcspdchgtunset""",
    "data are set by their name, so that their values are not known; assign them": """
        setalldataval setdataval""",
})  # fmt: skip

#: Motions whose path is not in the text: by a stream, back along the path, by force, by hand,
#: to identify.
UNSEEN = """
    egmmovec egmmovel egmrunjoint egmrunpose fcrefstart fricidevaluate loadid manloadidproc
    pathrecmovebwd pathrecmovefwd setleadthrough stepbwdpath""".split()  # noqa: SIM905 (a table)
#: Motions of an axis beside the arm: independent axes and spot guns.
ALONE = """
    closegun indamove indcmove inddmove indgunmove indrmove opengun setforce stclose stindgun
    stopen""".split()  # noqa: SIM905 (a table)
#: Instructions that give several of their arguments values, which are not known after them.
GIVES = """
    camgetparameter dagetappdescr dagetappindex dagetcurrdata dagetnumofprocs dagetnumofrob
    dagetprcdescr fitcircle getgroupsignalinfo getmaxusagetime gettorquemargin iobusstate
    matrixsolve matrixsolveqr matrixsvd readdir readerrdata readvararr
    sigetcyclic""".split()  # noqa: SIM905 (a table)

#: Triggers whose outputs are not read.
DEFINED = by_word({
    "an analog output along the path; set it by SetAO": "triggrampao triggspeed",
})  # fmt: skip

#: Arguments of motions: read, without an effect, lost, or omitted with the effect.
READ_OPTIONS = frozenset("t v wobj z".split())  # noqa: SIM905 (a table)
SILENT_OPTIONS = by_word({
    "the load that is carried": "tload",
    "offsets of external axes, which are left out": "noeoffs useeoffs",
    "a search runs to its end point, which is assumed": """
        flanks highlevel lowlevel negflank posflank pstop sstop stop sup""",
})  # fmt: skip
LOST_OPTIONS = by_word({
    "several robots move in step; give each a program of its own": "id",
    "a sensor corrects the path; teach the corrected path": "corr track",
    "outputs on the way in data of the type triggios; define them by TriggIO":
        "triggdata1 triggdata2 triggdata3",
})  # fmt: skip
OMITTED_OPTIONS = by_word({
    "the next instruction runs during the motion; here it waits for the motion": "conc",
    "how exactly the motion stops": "inpos",
})  # fmt: skip
