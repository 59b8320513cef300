"""The grammar of V+, form by form: what the controller takes, carried out or not, and what it turns down."""

import pytest

from camgen.read.programs import Ask
from camgen.read.vplus import run

#: Instructions that stand alone, by their pages of the Language Reference.
TAKEN = """\
ABORT 3
ACCEL 50
ACCEL 50, 60
ACCEL (2) 50, 60
ACCEL (x) y+1, z
AIO.OUT 1 = 0.5
ALIGN
APPRO p, 50
APPRO p:TRANS(1,2,3), x*2
APPRO SHIFT(p BY 1,2,3), -5
APPRO #p, 50
APPROS p[1], 50
APPROS p[i+1,j], h[k]
ATTACH
ATTACH ()
ATTACH (lun, 4) "TCP"
BASE 10,,5
BASE NULL
BITS 1 = 1
BITS 1, 8 = ^HFF
BRAKE
BREAK
CALIBRATE
CALL other
CALL other()
CALL other(1, x, (y), p, p:NULL, #q, $s, $s+"", a[], TRANS(1,2,3))
CALL other(, 2)
CALL other("a,b(c)", $MID($s,1,2), SHIFT(p BY 1,2,3))
CALLS "other"(1)
CALLS $name
CLOSE
CLOSEI
COARSE 200
COARSE ALWAYS
CPOFF
CPON ALWAYS
DECOMPOSE a[] = p
DECOMPOSE a[3] = #p
DECOMPOSE a[i,1] = HERE
DELAY 0.5
DEPART 50
DEPARTS x/2
DETACH
DETACH (0)
DETACH (lun)
DISABLE CP
DISABLE CP, POWER
DRIVE 1, 10
DRIVE 2, -x, 50
DURATION 1.5 ALWAYS
ENABLE DRY.RUN
ENABLE SCALE.ACCEL[1]
EXECUTE other
EXECUTE other()
EXECUTE 1 other(x, 2)
EXECUTE /C 1 other(), -1
EXECUTE (task) other()
FCLOSE (lun)
FCMND (lun, 600) $INTB(1)
FINE 50 ALWAYS
FLIP
FOPEN (lun, 16) "/LOCAL_PORT 1234"
FOPENR (lun) "D:a.dat"
FOPENW (lun) $name
GLOBAL a
HERE p
HERE #p
HERE p[1]
IGNORE 1001
INTOFF
JHERE a, b, c
JMOVE 1, 2, x, 4, 5, 6
KILL 2
LEFTY
LOCK 10
MC SPEED 50
MOVE p
MOVE #p
MOVE #PPOINT(1,2,3,4)
MOVE #PPOINT(1,2,3,4,5,x)
MOVE a:b:c
MOVE a:INVERSE(b):RZ(90)
MOVE FRAME(a,b,c,d):TRANS(1)
MOVE SHIFT(HERE BY 0,0,10)
MOVES DEST
MOVES p:TRANS(,,5)
MOVEST p, 1
MOVET #p, TRUE
MULTIPLE ALWAYS
NOFLIP
NONULL
NULL ALWAYS
OPEN
OPENI
PARAMETER HAND.TIME = 0.5
PARAMETER BELT.MODE = 1
PAUSE
PRIORITY 5
PROMPT "how many? ", n
PROMPT "name? ", $s
PROMPT $text, a, b
REACT 1001, other
REACT 1001, other(1), 5
REACTE other
REACTI -1002, other
READ (5) x
READ (lun, n, 1) $s, a[1], x
READY
RELAX
RELAXI
RESET
RETRY
RIGHTY
SELECT ROBOT = 2
SET p = q
SET p = NULL
SET p[1] = TRANS(1,2,3,4,5,6)
SET p = SCALE(q BY 2)
SET p = TOOL
SET #p = #q
SET #p = #PPOINT(1,2,3,4)
SET #p = #DEST
SETDEVICE 0, 1, e, 2
SIGNAL 1
SIGNAL -1, 2, x
SIGNAL (33)
SINGLE
SOLVE.ANGLES a[1], f, e = p, b[1]
SPEED 50
SPEED 50, 60
SPEED 50, 60 ALWAYS
SPEED 20 MMPS
SPEED 20, 100 MMPS ALWAYS
SPEED 2 IPS ALWAYS
SPEED 50 MONITOR
SPEED x/2, y MMPS ALWAYS
SWITCH CP = TRUE
TIMER 1 = 0
TIMER (x) = 0
TOOL
TOOL NULL
TOOL t
TOOL TRANS(0,0,100)
TYPE
TYPE "a", x, /S, /C1, $s
WAIT
WAIT SIG(1001)
WAIT SIG(1001, -1002) AND (x > 5)
WAIT DISTANCE(HERE, DEST) < 10
WAIT.EVENT
WAIT.EVENT 1
WAIT.EVENT , 0.5
WAIT.EVENT 1, 0.5
WRITE (lun) $s, x, /S
a.b_c = 1
x = y
x = -y*(2+z)/4 MOD 3
x = a[1]
x = a[i,j+1,2]
x[1] = 2
x[i,j] = x[j,i]
x[] = 1
x = NOT a AND (b OR c)
x = a == b
x = $s == "a"
x = ($s+"a" <> $t) OR (x > 1)
x = COM a BAND ^HFF BOR ^B101
x = IOSTAT(lun)
x = TIMER(1)
x = SIG(1001)
x = SPEED(2)
x = STATE(5)
x = TASK(1, 3)
x = ERROR(0, 0)
x = SWITCH(CP)
x = PARAMETER(HAND.TIME)
x = SELECT(ROBOT)
x = LAST(a[])
x = DEFINED(p)
x = GETC(lun, 1)
x = RANDOM*10
x = LEN($s)
x = VAL($MID($s, 2, 3))
x = INRANGE(p:q)
x = DX(p)
$s = "a;b"
$s = $t+"x"+$CHR(13)
$s[1] = "a"
$s = $ENCODE(x, "a", /F8.3, y, /I5, z)
$s = $DECODE($t, ",", 0)
$s = $ERROR(x)
$s = $TIME()
"""
#: Blocks, with a slash between their lines.
BLOCKS = """\
IF x THEN / y = 1 / END
IF (x == 1) AND NOT SIG(1001) THEN / ELSE / END
IF x GOTO 5 / 5
IF IOSTAT(lun) < 0 GOTO 5 / 5 y = 1
IF $s == "THEN" THEN / END
WHILE x < 5 DO / x = 9 / END
WHILE TRUE DO / EXIT / END
DO / x = 1 / UNTIL x
DO / UNTIL SIG(1001) OR (x > 5)
FOR i = 1 TO 5 / NEXT / END
FOR i = 10 TO 1 STEP -1 / END
FOR a[1] = 0 TO 1 STEP 0.1 / EXIT / END
FOR i = 1 TO 2 / FOR j = 1 TO 2 / EXIT 2 / END / END
CASE x OF / VALUE 1: / y = 1 / VALUE 2, 3, z: / ANY / y = 2 / END
CASE TRUE OF / VALUE (x > 1): / VALUE SIG(1001): / END
CASE $s OF / VALUE "a", "b": / END
10 GOTO 20 / 20
5   / x = 1 / GOTO 6 / 6 y = 1
RETURN
RETURNE
STOP
HALT
; only a comment
"""
REFUSED = """\
APPRO p
APPRO p,
BITS 1, 8
CALL
CALL 5
CALLS
COARSE 200 SOMETIMES
CPON NOW
DECOMPOSE a[]
DELAY
DEPART
DRIVE 1
ENABLE
EXECUTE
FOR i = 1 / END
FOR 1 = 1 TO 2 / END
FOR i = 1 TO 2
GOTO
GOTO 99
GOTO here.now
IF x
IF x THEN
IF THEN / END
CASE x / END
CASE x OF / VALUE 1 / END
CASE x OF
VALUE 1:
ANY
ELSE
END
UNTIL x
WHILE DO / END
WHILE x / END
DO
DO 5 / UNTIL x
EXIT
NEXT
JMOVE #[1,2,3]
LMOVE p
MOVE
MOVE 5
MOVE p q
MOVE p:
MOVE :p
MOVE (p
MOVE TRANS(1,2,3,4,5,6,7)
MOVE #PPOINT()
MOVEJ p
MOVET p
PARAMETER HAND.TIME
READ lun, x
RIGHTY NOW
SET p
SET p =
SET p = 5 6
SET $s = p
SET p = #q
SET #p = q
SET p = PPOINT(1,2,3,4)
SET p = SHIFT(q)
SET p = SHIFT(q BY 1,2,3,4)
SIGNAL
SPEED
SPEED 50 FAST
SPEED 50 MMPS IPS
TIMER 1
TOOL 5
TPWRITE "a"
UNTIL
WAIT.EVENT x y
WAITUNTIL x
x =
x = 1 +
x = (1
x = 1)
x = a[1
x = @
x = foo(1)
x = SIN()
x = SIN(1,2)
x = "a"
x = $s
x = p:q
x := 1
#p = #q
x + 1
$s = 1
$s = "a"+1
$s = $MID()
$x = "a
ELSEIF x THEN
"""


def found(text, ahead):
    """What is refused. ahead: what stands in front, such as a jump over all of it."""
    lines = [".PROGRAM a()", *ahead, *(part.strip() for part in text.split(" / ")), "7", ".END", ""]
    other = [".PROGRAM other(u, v, w)", ".END", ""]
    told = run({"a.v2": "\n".join([*lines, *other])}, Ask())
    assert told.stopped is None
    return [finding.what for finding in told.findings if finding.level == "refused"]


def labels(text):
    return {line: line for line in text.splitlines()}


@pytest.mark.parametrize("ahead", [[], ["GOTO 7"]], ids=["run", "not run"])
@pytest.mark.parametrize("text", labels(TAKEN + BLOCKS))
def test_taken(text, ahead):
    assert found(text, ahead if not text.startswith("GLOBAL") else []) == []


@pytest.mark.parametrize("ahead", [[], ["GOTO 7"]], ids=["run", "not run"])
@pytest.mark.parametrize("text", labels(REFUSED))
def test_refused(text, ahead):
    assert found(text, ahead) != []
