"""PacScript statements without a motion in the translation: by word, the reason or the effect.

Every word of the list of statements that no function carries out stands in one of these tables
(docs/languages/pacscript.md). `SILENT`: it moves and switches nothing, for a reason. `OMITTED`: it
changes how a program runs, and another machine runs without it; a build says so, and `--strict`
refuses. `LOST`: another machine would move or switch differently; a build is refused.
"""

from __future__ import annotations

from camgen.lang.word_tables import by_word

SILENT = by_word({
    "text, a screen or the pendant": """
        beep buzzer disp_screen page_change pagechange pagechangebyname pc_screen pendant_screen
        print printdbg printlbl printmsg""",
    "a file, a device or a line; values read from it are asked for where they are used": """
        com_discom com_encom comclose flush write writebytearray swapbytearray""",
    "a log": "clearlog clearservolog startlog startservolog stoplog stopservolog syslog",
    "a mutex, a semaphore or the rank of a task": """
        deletemutex deletesem givemutex givesem resetmutex semid setpriority takemutex takesem""",
    "a value for another program": "setpublicvalue",
    "a supervision, which stops an arm at a fault": "setcollisiondetection srvunlock clrerr",
    "the sensor of force, without a motion by itself": "forcesensor forcesensorpayload",
    "a remark, an option or the clock": "date keep option randomize rem",
})  # fmt: skip

OMITTED = by_word({
    "accelerations": "accel decel extaccel extdecel jaccel jdecel",
    "the speed of joint motions": "jspeed speedmode",
    "the load": "aspacle payload st_aspchange",
    "the path between the points": """
        cpmode highpathaccuracy loadpathpoint singularavoid""",
    "the servo: gravity, currents and allowed deviations": """
        eralw grvctrl grvoffset st_gravity st_grvoffset st_resetcurlimit st_resetcurlmt
        st_reseteralw st_seteralw""",
    "when the program goes on": """
        angulartrigger crtmotionallow encmotionallow encmotionallowjnt forcewaitcondition
        motiontimeout""",
    "outputs and stops by the place of the tool": """
        area clearareadetected exclusivearea resetarea resetexclusivearea setarea
        setexclusivearea""",
    "an event of the controller; what it starts is not run": """
        addhandler interruptvision ontimer removehandler""",
    "another task": "kill killall killbyname suspend suspendall suspendbyname",
    "the value of an axis": "posclr",
})  # fmt: skip

LOST = by_word({
    "the servo is soft, so that the arm gives way; another arm would press": """
        curlmt st_setcomplinit st_setcurlmt zforce""",
    "force control moves the arm; another arm needs a program of its own": "forcechangetable",
    "an output of the hand; switch an IO": "sethandio",
    "the robot follows a conveyor; take it out, or teach the path at rest": """
        trackapproach trackbufferdelete trackbuffersort trackdepart trackinitialize trackmove
        trackoffsetmargin tracksetsensor tracksetvision trackstandbypos trackstart trackstartarea
        trackstop tracktargetoffset tracktargetrelease""",
})  # fmt: skip

#: Options of motions without an effect in the translation, by name, and their effect.
OMITTED_OPTIONS = by_word({
    "accelerations": "accel decel",
    "the time that it takes": "time",
})  # fmt: skip
