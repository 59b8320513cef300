"""V+ instructions without a motion in the translation: by word, the reason or the effect.

Every keyword of the Language Reference Guide without a method is in one of these tables, also
those of AdeptVision, ACE Sight and conveyor tracking as far as its index names them
(docs/languages/vplus.md).
"""

from __future__ import annotations

from camgen.lang.word_tables import by_word

#: They move and switch nothing, each for a reason.
SILENT = by_word({
    "text, graphics or a screen": """
        GARC GCHAIN GCLEAR GCLIP GCOLOR GCOPY GFLOOD GGETLINE GICON GLINE GLINES GLOGICAL GMODE
        GPANEL GPOINT GRECTANGLE GSCAN GSLIDE GTEXTURE GTRANS GTYPE KEYMODE PDNT.CLEAR PDNT.NOTIFY
        PDNT.WRITE PENDANT TYPE WRITE""",
    "a file or a device; what is read from it is asked for where it is used": """
        FCLOSE FCMND FDELETE FDIRECTORY FEMPTY FOPEN FOPENA FOPEND FOPENR FOPENW FSEEK FSET IOGET
        SETDEVICE""",
    "a camera; what it finds is asked for where it is used": """
        SEE VAUTOTHR VCORRELATE VDEF.AOI VDEF.GRIP VDISPLAY VEDGE VLOCATE VPARAMETER VPICTURE VPLAN
        VRECALL VRULER VRUN VSELECT VSHOW VSTORE VSUBMIT VTRAIN VWAIT VWINDOW""",
    "the end of a reaction, or its rank: reactions do not come": "IGNORE LOCK",
    "an event of tasks, or their rank": """
        CLEAR.EVENT CLR.EVENT INT.EVENT INTOFF INTON PRIORITY RUNSIG SET.EVENT""",
    "a latched position, asked for where it is used": "LATCH",
    "a number of strings": "PACK UNPACK",
    "the set-up of a controller": "DEF.DIO INSTALL MODULE SIG.INS",
    "nothing at all": "NOOP",
})  # fmt: skip
#: They change how a program runs, and another machine runs without them. A build says so.
OMITTED = by_word({
    "accelerations": "ACCEL",
    "the load": "PAYLOAD",
    "when motions overlap": "NOOVERLAP OVERLAP",
    "the sense in which a joint turns": "UNIDIRECT",
    "the robot, its calibration or its options": "CALIBRATE ROBOT.OPR",
    "another task": "ABORT CYCLE.END KILL PROCEED PROG.START RETRY",
    "a command of the monitor": "MC MCS",
})  # fmt: skip
#: Motions whose target is not in the program text.
UNSEEN = ("ALTER", "ALTOFF", "ALTON", "FORCE", "JOG", "MOVEC", "MOVEF", "MOVESC", "MOVESF")
#: Another machine would move or switch differently without them. A build is refused.
LOST = by_word({
    "a belt moves the locations; teach the path at rest": "BELT DEFBELT SETBELT WINDOW",
    "an analog output or an output of a device; switch a digital one": "AIO.OUT IOPUT",
    "a sensor or an option moves the robot; teach the path without it": " ".join(UNSEEN),
})  # fmt: skip
#: Switches and parameters without an effect on motion, outputs or time that is not read.
SILENT_SWITCHES = by_word({
    "read: continuous path, power, dry run": "cp power dry.run",
    "messages and traces": "messages trace upper retry monitors interactive",
})  # fmt: skip
SILENT_PARAMETERS = by_word({
    "read: the time of the hand": "hand.time",
    "the screen and its keys": "terminal screen.timeout",
})  # fmt: skip
