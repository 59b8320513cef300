"""The grammar of PacScript: each production accepted in its forms, and forms that are none refused."""

import pytest

from camgen.read.pacscript import LANGUAGE
from camgen.read.programs import Ask, Executed


def run(*lines: str, head: str = "", **assume: float) -> Executed:
    """What a Main of these lines does; they begin at line 3 + the lines of ``head``."""
    body = "\n".join(lines)
    text = f"{head}Sub Main\nTakeArm Keep = 0\n{body}\nEnd Sub\n"
    return LANGUAGE.run({"part.pcs": text}, Ask(assume=assume))


def refused(found: Executed) -> list[tuple[int, str]]:
    return [(one.line, one.what) for one in found.findings if one.level == "refused"]


P1 = "Move P, @0 P(400, 0, 300, 180, 0, 180, -1)"

ACCEPTED = [
    # statements and lines
    "x = 1 ' a comment",
    "Rem a comment",
    "REM",
    "x = 1 : y = 2",
    "x = 1 + _\n  2",
    'Call f("a", _\n  2)',
    's = "it\'s no comment"',
    "#Define SIGNAL 24\nSet IO[SIGNAL]",
    "#Define A B\n#Define B 3\nx = A",
    "#If 1 = 2\nnonsense ( here\n#Else\nx = 1\n#EndIf",
    "#Ifdef NOBODY\nnonsense ((\n#EndIf",
    "#Ifndef NOBODY\n#Define NOBODY\n#EndIf",
    "#If __SCARA_ROBOT__ = 1\nnonsense ((\n#ElIf __RC8__\nx = 1\n#EndIf",
    "#Define A 1\n#Undef A\n#Ifdef A\nnonsense ((\n#EndIf",
    "#Pragma Encrypt(On)",
    "#Warning take care",
    # names and values
    "Dim a As Integer, b As Single, c As String, d As Variant",
    "Dim a As Integer = 42",
    "Dim p As Position = P(1.2, 4.3, 4.5)",
    "Dim a(3) As Integer\na(3) = 1",
    "Dim a(3, 4) As Single\na(3, 4) = 1.5",
    "Dim o As Object",
    "x = &B1010 + &HFF",
    "x = .5 + 2. + 1E3 + 1.5e-2",
    "x = -1 - -2 + +3",
    "x = 2 ^ 3 * 4 / 2 Mod 3 \\ 2",
    "x = (1 < 2) And (2 <= 2) Or Not (3 > 4) Xor (1 >= 2)",
    "x = 1 <> 2",
    "x = 1 == 1",
    "x = 1 << 3 >> 2",
    's = "a" & "b" + "c"',
    's = Sprintf("%d,%5.2f,%s", 1, 2.5, "x")',
    'v = Split("1,2,3", ",")\nx = Val(v(2))',
    "v = Array(1, Array(2, 3))\nx = v(1)(0)",
    "I[5] = 3\nI5 = I[5] + 1",
    'F1 = 2.5\nD[2] = 1\nS[1] = "a"\nV1 = V(1, 2, 3)\nT[1] = P2T(P(1, 2, 3))\nJ[1] = J(1, 2, 3)',
    "p = P(1, 2, 3)\nLetX p = 5\nLetRz p = 90\nLetF p = -2",
    "Dim j As Joint\nLetJ 1, j = 10",
    "x = PosX(P(1, 2, 3)) + Joint(1, J(1, 2))",
    "x = Dist(P(0, 0, 0), P(3, 4, 0)) + Sin(30) + Atan2(1, 1) + Sqr(2)",
    # the way through
    "If 1 = 1 Then\nx = 1\nElseIf 1 = 2 Then\nx = 2\nElse\nx = 3\nEnd If",
    "If 1 = 1 Then x = 1",
    "If 1 = 1 Then x = 1 Else x = 2",
    "If 1 = 1 Then x = 1 : y = 2",
    "If (1 = 1) Then\nEndIf",
    "For i = 1 To 3\nNext",
    "For i = 3 To 1 Step -1\nNext i",
    "For i = 1 To 9\nIf i = 5 Then Exit For\nNext i",
    "Do While x < 3\nx = x + 1\nLoop",
    "Do Until x = 3\nx = x + 1\nLoop",
    "Do\nx = x + 1\nLoop Until x > 3",
    "Do\nx = x + 1\nLoop While x < 3",
    "Do\nx = x + 1\nIf x > 3 Then Exit Do\nLoop",
    "Do\nx = x + 1\nIf x > 3 Then\nExit Loop\nEnd If\nLoop",
    "While x < 3\nx = x + 1\nWend",
    "Select Case 3\nCase 1, 2\nx = 1\nCase 3 To 5\nx = 2\nCase Is > 5\nx = 3\nCase Else\nx = 4\nEnd Select",
    'Select Case "a"\nCase "a"\nx = 1\nEnd Select',
    "GoTo *there\nx = 1\n*there:",
    "Goto there\nx = 1\nthere:\nx = 2",
    "GoTo there\nthere: x = 2",
    "On Error GoTo there\nExit Sub\nthere:\nResume Next",
    "On 2 GoTo *a, *b\n*a\n*b",
    "GoSub *a\nExit Sub\n*a\nReturn",
    "Exit Sub",
    "Call Main2\nMain2 1, 2\nMain2(1)",
    'Comm.Open 8\nComm.Output 8, "x"\ns = Comm.Input(8)',
    'o = Cao.AddController("a", "b")\no.Value = 1\nx = o.Value',
    "Run ..\\Folder\\Other(1, 2)",
    "Run Other\nKill Other",
    # the arm
    "Move P, P(1, 2, 3)",
    "Move PTP, @P P1",
    "Move L, @E P[1]",
    "Move L, @C P[1]",
    "Move L, @20 P(1, 2, 3)",
    "Move L, @[5] P(1, 2, 3)",
    "Move L, @[x + 1] P(1, 2, 3)",
    "Move P, @P P[2] Ex((7, 10)), @P P[5], P[8], P[15], Speed = 30, Next",
    "Move P, J(0, 45, 90, 0, 45, 0) ExA((7, 10))",
    "Move P, P(1, 2, 3), Speed = 50, Accel = 80, Decel = 70",
    "Move P, P(1, 2, 3), S = 50, Next",
    "Move P, P(1, 2, 3), Speed = (50, 40, 40)",
    "Move P, P(1, 2, 3), Time = 500",
    f"{P1}\nMove C, P(500, 100, 300, 180, 0, 180), @P P(600, 0, 300, 180, 0, 180)",
    "Move S, 1",
    "Approach P, P[10], @P 40 Ex((7, 10)), Speed = 30",
    "Approach L, P(1, 2, 3), 20",
    f"{P1}\nDepart L, @0 25\nDraw L, V(1, 2, 3), S = 80\nRotateH @P 30\nRotate XY, 45, V(0, 0, 0), pose = 1",
    f"{P1}\nArchMove P(500, 0, 300, 180, 0, 180), 20\nArchMove P1, 20, 5, 5",
    "DriveA @0 (1, 0), (2, 45)\nDrive (1, 10), (2, -5), Speed = 20\nDriveA J(1, 2, 3, 4, 5, 6)",
    "GoHome\nHome P(1, 2, 3)",
    "GiveArm\nTakeArm 0 Keep = 1\nTakeArm 0, Keep = 0\nTakeArm",
    "Motor On\nMotor Off\nMotor True",
    "Speed 50\nJSpeed 20\nAccel 50, 40\nDecel 40\nExtSpeed 30\nExtSpeed 30, 20, 20",
    "Tool 1, P(0, 0, 100)\nChangeTool 1\nWork 1, P(1, 2, 3)\nChangeWork 1",
    "SingularAvoid 2\nCPMode 1\nSpeedMode 1\nPayload 500, V(0, 0, 50)\nErAlw 1, 2, 2\nGrvCtrl True",
    "ForceParam 1, 2, P(0, 0, -10)\nForceCtrl True, 1\nForceCtrl False",
    "ForceParam 1, 2, P(0, 0, -10), Rate = P(1), SpMax = 5",
    # signals and time
    "Set IO[24]\nReset IO[24]\nSet IO24\nSet IO[24], 500\nSet IO[24 To 31]",
    "Set IO[128] = 0\nIO[240] = Off",
    "DefIO lamps = Byte, 64\nlamps = 3\nx = lamps",
    "Wait IO[8] = On\nWait (IO[8] = On), 500\nWait (IO[8] = On), 500, ok",
    "Delay 100\nArrive 50\nWaitMotion 0, 50\nInterrupt On\nMotionSkip 0, 1",
    'PrintDbg "x"; 1\nPrintMsg "x", 2, "y"\nMsgBox("x" & 1)\nx = MsgBox("x", 1)',
    "CreateMutex\nTakeMutex m\nGiveMutex m",
]


@pytest.mark.parametrize("text", ACCEPTED)
def test_forms_of_the_language_are_taken(text: str) -> None:
    found = run(*text.split("\n"))
    assert not refused(found)
    assert found.stopped is None


REFUSED = [
    ("x = (1 + 2", 3, ") is missing"),
    ("x = 1 + ", 3, "a value is missing"),
    ("x = 1 2", 3, "2 is not understood in 1 2"),
    ("x = * 2", 3, "* is not understood"),
    ("Move Q, P(1)", 3, "Q is no interpolation of this motion"),
    ("Move L, @Q P(1)", 3, "the pass mark of @Q P(1) is not understood"),
    ("Move P, @0, P10", 3, "a pass mark without a target"),
    ("Move P", 3, "a motion without a target"),
    ("Move L, P(1, 2, 3,), ", 3, "a value is missing"),
    ("Move L, P(1", 3, ") is missing"),
    ("If 1 = 1", 3, "If without Then"),
    ("If 1 = 1 Then", 3, "If has no End If"),
    ("End If", 3, "End If without If"),
    ("Else", 3, "Else without If"),
    ("For i = 1 To 3", 3, "For has no Next"),
    ("For i = 1", 3, "For needs a name, = and To"),
    ("Next", 3, "Next without For"),
    ("Do", 3, "Do has no Loop"),
    ("Loop", 3, "Loop without Do"),
    ("While 1", 3, "While has no Wend"),
    ("For i = 1 To 3\nLoop\nNext", 4, "Loop without Do inside For"),
    ("Select Case x", 3, "Select Case has no End Select"),
    ("Case 1", 3, "Case without Select Case"),
    ("Exit For", 3, "Exit For outside such a block"),
    ("GoTo nowhere", 3, "there is no label nowhere"),
    ("*a\n*a", 4, "a second label a"),
    ("Dim 3x As Integer", 3, "3x As Integer cannot be declared"),
    ("Dim Move As Integer", 3, "Move As Integer cannot be declared"),
    ("Speed = 3", 3, "= is not understood"),
    ("Wait", 3, "Wait needs a condition"),
    ("Speed 500", 3, "a speed of 500 %: the controller takes 0.1 to 100"),
    ("ExtSpeed 0", 3, "an external speed of 0 %: the controller takes up to 100"),
    ("ChangeTool 99", 3, "tool 99: there are 0 to 63"),
    ("Delay -5", 3, "a delay of -5 ms"),
    ("x = 1 / 0", 3, "a division by zero"),
    ("Dim a(3) As Integer\na(4) = 1", 4, "there is no element (4): the array ends at (3)"),
    ("Set IO[30000]", 3, "IO[30000]: the highest is IO[24063]"),
    ("Motor Off\nMove P, P(1, 2, 3)", 4, "a motion with the motor off"),
    ("GiveArm\nMove P, P(1, 2, 3)", 4, "a motion without TakeArm: the controller stops with an error"),
    ("#Nonsense", 3, "#nonsense is no directive"),
    ("#Error stop here", 3, "#Error stop here"),
    ("#Define A A B\nx = A", 4, "a macro that refers to itself or grows without end"),
    ("x = " + "1 + " * 300 + "1", 3, "a line of more than 1024 bytes"),
]


@pytest.mark.parametrize(("text", "line", "what"), REFUSED)
def test_what_the_language_has_not_is_refused(text: str, line: int, what: str) -> None:
    assert (line, what) in refused(run(*text.split("\n")))


OUTSIDE = [
    ("x = 1\nSub Main\nEnd Sub\n", 1, "a statement outside a procedure"),
    ("Sub Main\n", 1, "the procedure has no end"),
    ("End Sub\nSub Main\nEnd Sub\n", 1, "End Sub closes nothing"),
    ("Sub Main\nSub Other\nEnd Sub\n", 2, "Sub Other begins inside another procedure"),
    ("Sub Main\nEnd Sub\nSub Other\nEnd Sub\nSub Other\nEnd Sub\n", 5, "a second procedure Other"),
    ("Sub Main\nEnd Sub\nSub Move\nEnd Sub\n", 3, "Move is a word of the language"),
    ("Sub Main\nEnd Sub\nSub Other(1)\nEnd Sub\n", 3, "parameters that cannot be read"),
    ("#If 1\nSub Main\nEnd Sub\n", 1, "#If has no #EndIf"),
    ("#EndIf\nSub Main\nEnd Sub\n", 1, "#EndIf without #If"),
    ("Sub Main\nx = 1 _", 2, "the statement goes on after the last line"),
]


@pytest.mark.parametrize(("text", "line", "what"), OUTSIDE)
def test_what_stands_around_procedures_is_judged(text: str, line: int, what: str) -> None:
    assert (line, what) in refused(LANGUAGE.run({"part.pcs": text}, Ask()))


def test_procedures_that_do_not_run_are_judged_too() -> None:
    found = LANGUAGE.run({"part.pcs": "Sub Main\nEnd Sub\nSub Other\nx = (\nEnd Sub\n"}, Ask())
    assert refused(found) == [(4, "a value is missing")]


@pytest.mark.parametrize(
    "text",
    [
        '\'!TITLE "part"\nSub Main\nEnd Sub\n',
        "Sub Main\n  TakeArm Keep = 0\n  Move P, @0 P1\nEnd Sub\n",
        "PROGRAM PRO1\nTAKEARM\nMOVE P, P1\nEND\n",
    ],
)
def test_the_language_is_recognised(text: str) -> None:
    assert LANGUAGE.recognise(text)


@pytest.mark.parametrize(
    "text", ["MODULE a\nPROC main()\nENDPROC\nENDMODULE\n", ".PROGRAM a()\nMOVE b\n.END\n", "G21\nG0 X1\n", ""]
)
def test_other_languages_are_not(text: str) -> None:
    assert not LANGUAGE.recognise(text)
