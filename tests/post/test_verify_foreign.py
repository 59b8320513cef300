"""`camgen verify` on third-party programs: its summary and its findings by line."""

from pathlib import Path

import pytest

from camgen.cli import main

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
needs_shared = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the folder shared/data is not beside the repository"
)


def verify(capsys, path, post):
    """Returns the exit code, the summary by its labels, the findings, and the error."""
    code = main(["verify", str(path), "--post", post])
    shown = capsys.readouterr()
    lines = shown.out.splitlines()
    summary = {line[:10].strip(): line[10:].strip() for line in lines if " line " not in line[:60]}
    start = f"{path.name} "
    findings = [line.removeprefix(start) for line in lines if line.startswith(f"{start}line")]
    return code, summary, findings, shown.err


def write(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text, encoding="latin-1")
    return path


RAPID = """\
MODULE a
    PERS tooldata tA:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
    CONST robtarget p1:=[[100,0,50],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
    CONST robtarget p2:=[[200,0,50],[0,0.9,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
    CONST robtarget p3:=[[300,0,50],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
    CONST num a_name_that_is_longer_than_thirty_two_characters:=1;
    PROC main()
        MoveJ p1,v100,fine,tA;
        MoveL p3,v100,z5,tA;
        SetDO doGrip,1;
        MoveL p9,v100,fine,tA;
        MoveC [[200,0,50],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],p1,v100,fine,tA;
        MoveL p3,vMine,fine,tA;
        ArcLStart p1,v100,seam1,weld1,fine,tA;
    ENDPROC
ENDMODULE
"""


def test_the_faults_of_a_rapid_program_have_their_lines(capsys, tmp_path):
    code, summary, findings, error = verify(capsys, write(tmp_path, "a.mod", RAPID), "rapid")
    assert code == 2
    assert findings == [
        "line 6: refused: a_name_that_is_longer_than_thirty_two_ch is longer than 32 characters",
        (
            "line 10: dangerous: doGrip is switched while the robot is still in a corner: the "
            "motion in line 9 blends"
        ),
        "line 15: dangerous: the arc still burns at the end: ArcLEnd is missing",
    ]
    assert "1 line is refused, first: a_name_that_is" in error
    assert summary["extents"] == "x 100 to 300, y 0 to 0, z 50 to 50 mm"
    # The motion to p9, which is not declared, is left out. The arc after it starts at p3.
    assert summary["straight"] == "600.0 mm"


def test_a_third_party_program_without_faults_has_a_summary(capsys, tmp_path):
    lines = RAPID.splitlines()
    kept = [line for k, line in enumerate(lines, 1) if k not in (4, 6, 9, 11, 12, 13, 14)]
    text = "\n".join(kept).replace(
        "SetDO doGrip,1;", "MoveL p3,v50,fine,tA;\n        SetDO doGrip,1;"
    )
    code, summary, findings, error = verify(capsys, write(tmp_path, "good.mod", text), "rapid")
    assert (code, error) == (0, "")
    assert findings == []
    assert summary["straight"] == "200.0 mm"
    assert summary["output"] == "doGrip: 1"
    assert summary["speed"] == "50 to 100 mm/s"


@pytest.mark.parametrize(
    ("post", "name", "text", "expected"),
    [
        (
            "vplus",
            "a.v2",
            (
                ".PROGRAM main()\n    SPEED 100 MMPS ALWAYS\n    MOVES p2\n    SIGNAL 5\n"
                "    CLOSEI\n.END\n"
            ),
            {
                (
                    "line 4: dangerous: signal 5 switches while the motion before it still "
                    "runs: BREAK is missing"
                )
            },
        ),
        (
            "pacscript",
            "a.pcs",
            "Sub Main\n  TakeArm\n  P1 = P(\n  GiveArm\nEnd Sub\n",
            {"line 3: refused: a value is missing"},
        ),
        (
            "grbl",
            "a.nc",
            "G21\nG81 X1 Z-1 R1 F9\nG1 X1 F9\nM2\n",
            {"line 2: refused: G81 is not a code of grbl"},
        ),
    ],
)
def test_an_unknown_statement_is_reported(capsys, tmp_path, post, name, text, expected):
    code, _, findings, _ = verify(capsys, write(tmp_path, name, text), post)
    for start in expected:
        assert any(line.startswith(start) for line in findings)
    assert code == (3 if post == "vplus" else 2)


def test_g_code_with_words_that_no_post_writes_is_run(capsys, tmp_path):
    """Three holes at corners of a square of 10 mm, each of 7 mm at the feed."""
    text = (
        "G21 G90 G64 P0.01\n#1=10\nG0 Z20\nG0 X0 Y0\nG98 G81 X0 Y0 Z-5 R2 F60\nX#1\nY#1\nG80\nM2\n"
    )
    code, summary, findings, error = verify(capsys, write(tmp_path, "holes.ngc", text), "gcode")
    assert (code, error) == (0, "")
    assert findings == []
    assert summary["straight"] == "21.0 mm"
    assert summary["extents"] == "x 0 to 10, y 0 to 10, z -5 to 20 mm"


def test_a_remark_is_a_fault_in_a_program_of_camgen(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    old = write(tmp_path, "old.nc", "G21\nG0 X0 Y0 Z5\nG1 Z0 F60\nX9\nM2\n")
    outputs = ["-o", "new.ngc", "--plan", "plan.json"]
    with_plan = ["verify", "new.ngc", "--post", "gcode", "--plan", "plan.json"]
    assert main(["build", str(old), "--post", "gcode", *outputs, "-q"]) == 0
    assert main(with_plan) == 0
    text = (tmp_path / "new.ngc").read_text()
    (tmp_path / "new.ngc").write_text(text.replace("M2", "#1=2\nM2"))
    capsys.readouterr()
    assert main(["verify", "new.ngc", "--post", "gcode"]) == 0
    assert main(with_plan) == 2
    (tmp_path / "new.ngc").write_text(text.replace("X9", "X8"))
    assert main(with_plan) == 4


#: Language, exit code, and a finding of each shared program.
EXPECTED = {
    "Program.mod": (
        "rapid",
        3,
        (
            "line 33: dangerous: D_OUT_5 is switched while the robot is still in a corner: the "
            "motion in line 31 blends"
        ),
    ),
    "Prog1.pg": ("vplus", 2, "line 6: refused: LMOVE is not an instruction of V+"),
    "Kawasaki.pg": ("vplus", 2, "line 7: refused: C1MOVE is not an instruction of V+"),
    "flowsnake.ngc": ("gcode", 0, ""),
    "g17-g98-g81.ngc": ("gcode", 0, ""),
    "bad-arc.small.metric.center-format.ngc": (
        "gcode",
        2,
        "line 6: refused: the radii of the arc differ by 0.0286 mm (start 24.9857, end 25.0143)",
    ),
    "tball-engrave.gcode": ("gcode", 0, ""),
    "helical-thread-milling.gcode": ("gcode", 0, ""),
    "full-circle-without-xyz.gcode": (
        "gcode",
        2,
        "line 11: refused: arc without a centre or radius (I, J, K or R) in its plane",
    ),
    "Circle_Diamond_Square_Calibration.gcode": (
        "gcode",
        2,
        "line 624: refused: the radii of the arc differ by 1.4138 mm (start 29.0000, end 27.5862)",
    ),
}


@needs_shared
@pytest.mark.parametrize("name", EXPECTED)
def test_a_shared_program_has_its_exit_code_and_finding(capsys, name):
    post, exit_code, line = EXPECTED[name]
    (path,) = SHARED.rglob(name)
    code, _, findings, _ = verify(capsys, path, post)
    assert code == exit_code
    assert line in findings or not (line or findings)


#: Lengths at the feed as LinuxCNC runs them, straight and in arcs, mm (shared/data/README.md).
MEASURED = {
    "flowsnake.ngc": (25.556, 0.0),
    "g17-g98-g81.ngc": (419.1, 0.0),
    "circle.gcode": (1.0, 31.416),
    "circle-inch.gcode": (5.08, 79.796),
    "smooth_curves_circular_interpolation.gcode": (202.834, 793.756),
    "g2-arc.gcode": (184.142, 31.416),
}


@needs_shared
@pytest.mark.parametrize("name", MEASURED)
def test_the_lengths_are_those_of_linuxcnc(capsys, name):
    (path,) = SHARED.rglob(name)
    _, summary, _, _ = verify(capsys, path, "gcode")
    lengths = [float(summary[kind].removesuffix(" mm")) for kind in ("straight", "arcs")]
    assert lengths == pytest.approx(MEASURED[name], abs=0.06)
