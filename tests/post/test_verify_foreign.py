"""``camgen verify`` on programs that camgen did not write: what they do, what is wrong in which line, no guess."""

from pathlib import Path

import pytest

from camgen.cli import main

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
needs_shared = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the folder shared/data is not beside the repository"
)


def verified(capsys, path, post):
    """Exit code, the page by its labels, the lines about lines, and the error."""
    code = main(["verify", str(path), "--post", post])
    shown = capsys.readouterr()
    page = {
        line[:10].strip(): line[10:].strip()
        for line in shown.out.splitlines()
        if " line " not in line[:60]
    }
    told = [
        line.removeprefix(f"{path.name} ")
        for line in shown.out.splitlines()
        if line.startswith(f"{path.name} line")
    ]
    return code, page, told, shown.err


def written(tmp_path, name, text):
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


def test_faults_of_a_rapid_program_have_their_lines(capsys, tmp_path):
    code, page, told, error = verified(capsys, written(tmp_path, "a.mod", RAPID), "rapid")
    assert code == 2
    assert told == [
        "line 6: refused: a_name_that_is_longer_than_thirty_two_ch is longer than 32 characters",
        "line 10: dangerous: doGrip is switched while the robot is still in a corner: the motion in line 9 blends",
        "line 15: dangerous: the arc still burns at the end: ArcLEnd is missing",
    ]
    assert "1 line is refused, first: a_name_that_is" in error
    assert page["extents"] == "x 100 to 300, y 0 to 0, z 50 to 50 mm"
    # To p9, which nobody knows, nothing leads; the arc from there has its length from where the arm was before.
    assert page["straight"] == "600.0 mm"


def test_a_sound_foreign_program_says_what_it_does(capsys, tmp_path):
    lines = RAPID.splitlines()
    kept = [line for k, line in enumerate(lines, 1) if k not in (4, 6, 9, 11, 12, 13, 14)]
    text = "\n".join(kept).replace(
        "SetDO doGrip,1;", "MoveL p3,v50,fine,tA;\n        SetDO doGrip,1;"
    )
    code, page, told, error = verified(capsys, written(tmp_path, "good.mod", text), "rapid")
    assert (code, error) == (0, "")
    assert told == []
    assert page["straight"] == "200.0 mm"
    assert page["output"] == "doGrip: 1"
    assert page["speed"] == "50 to 100 mm/s"


@pytest.mark.parametrize(
    ("post", "name", "text", "said"),
    [
        (
            "vplus",
            "a.v2",
            ".PROGRAM main()\n    SPEED 100 MMPS ALWAYS\n    MOVES p2\n    SIGNAL 5\n    CLOSEI\n.END\n",
            {
                "line 4: dangerous: signal 5 switches while the motion before it still runs: BREAK is missing"
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
def test_what_is_not_known_is_named(capsys, tmp_path, post, name, text, said):
    code, _, told, _ = verified(capsys, written(tmp_path, name, text), post)
    assert all(any(line.startswith(one) for line in told) for one in said)
    assert code == (3 if post == "vplus" else 2)


def test_g_code_with_words_that_no_post_writes_is_run(capsys, tmp_path):
    """Three holes on a square of 10 mm, 8 mm down each: 3 times 7 mm at feed."""
    text = (
        "G21 G90 G64 P0.01\n#1=10\nG0 Z20\nG0 X0 Y0\nG98 G81 X0 Y0 Z-5 R2 F60\nX#1\nY#1\nG80\nM2\n"
    )
    code, page, told, error = verified(capsys, written(tmp_path, "holes.ngc", text), "gcode")
    assert (code, error) == (0, "")
    assert told == []
    assert page["straight"] == "21.0 mm"
    assert page["extents"] == "x 0 to 10, y 0 to 10, z -5 to 20 mm"


def test_a_remark_is_a_fault_in_a_program_of_our_own(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    old = written(tmp_path, "old.nc", "G21\nG0 X0 Y0 Z5\nG1 Z0 F60\nX9\nM2\n")
    assert (
        main(["build", str(old), "--post", "gcode", "-o", "new.ngc", "--plan", "plan.json", "-q"])
        == 0
    )
    assert main(["verify", "new.ngc", "--post", "gcode", "--plan", "plan.json"]) == 0
    text = (tmp_path / "new.ngc").read_text()
    (tmp_path / "new.ngc").write_text(text.replace("M2", "#1=2\nM2"))
    capsys.readouterr()
    assert main(["verify", "new.ngc", "--post", "gcode"]) == 0
    assert main(["verify", "new.ngc", "--post", "gcode", "--plan", "plan.json"]) == 2
    (tmp_path / "new.ngc").write_text(text.replace("X9", "X8"))
    assert main(["verify", "new.ngc", "--post", "gcode", "--plan", "plan.json"]) == 4


#: What the shared programs are found to be: exit code, and a line that must be told.
FOUND = {
    "Program.mod": (
        "rapid", 3,
        "line 33: dangerous: D_OUT_5 is switched while the robot is still in a corner: the motion in line 31 blends",
    ),
    "Prog1.pg": ("vplus", 2, "line 6: refused: LMOVE is not an instruction of V+"),
    "Kawasaki.pg": ("vplus", 2, "line 7: refused: C1MOVE is not an instruction of V+"),
    "flowsnake.ngc": ("gcode", 0, ""),
    "g17-g98-g81.ngc": ("gcode", 0, ""),
    "bad-arc.small.metric.center-format.ngc": (
        "gcode", 2,
        "line 6: refused: the radii of the arc differ by 0.0286 mm (start 24.9857, end 25.0143)",
    ),
    "tball-engrave.gcode": ("gcode", 0, ""),
    "helical-thread-milling.gcode": ("gcode", 0, ""),
    "full-circle-without-xyz.gcode": (
        "gcode", 2, "line 11: refused: arc without a centre or radius (I, J, K or R) in its plane",
    ),
    "Circle_Diamond_Square_Calibration.gcode": (
        "gcode", 2, "line 624: refused: the radii of the arc differ by 1.4138 mm (start 29.0000, end 27.5862)",
    ),
}  # fmt: skip


@needs_shared
@pytest.mark.parametrize("name", FOUND)
def test_shared_programs(capsys, name):
    post, expected, line = FOUND[name]
    (path,) = SHARED.rglob(name)
    code, _, told, _ = verified(capsys, path, post)
    assert code == expected
    assert line in told or not (line or told)


#: Measured with LinuxCNC's interpreter (shared/data/README.md): mm at feed, straight and in arcs.
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
def test_lengths_are_those_that_linuxcnc_measures(capsys, name):
    (path,) = SHARED.rglob(name)
    _, page, _, _ = verified(capsys, path, "gcode")
    lengths = [float(page[kind].removesuffix(" mm")) for kind in ("straight", "arcs")]
    assert lengths == pytest.approx(MEASURED[name], abs=0.06)
