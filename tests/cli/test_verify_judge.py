"""`camgen verify` of programs from elsewhere: findings, assumptions, options and the page."""

import json
import re
from pathlib import Path

import pytest

from camgen.cli import main

RAPID = """\
MODULE shop
  PERS tooldata tGun:=[TRUE,[[0,0,200],[1,0,0,0]],[2,[0,0,80],[1,0,0,0],0,0,0]];
  CONST robtarget p1:=[[600,0,400],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    MoveJ p1,v500,fine,tGun;
    MoveL Offs(p1,0,100,0),v100,fine,tGun;
    SetDO doGun,1;
    IF diReady=1 THEN
      MoveL Offs(p1,0,200,0),v100,fine,tGun;
    ELSE
      MoveL Offs(p1,50,100,0),v100,fine,tGun;
    ENDIF
    SetDO doGun,0;
  ENDPROC
  PROC other()
    MoveJ p1,v500,fine,tGun;
  ENDPROC
ENDMODULE
"""
SQUARE = "G21 G90\nG0 X0 Y0 Z5\nM3 S1000\nG1 Z-1 F100\nX10\nY10\nX0\nY0\nG0 Z5\nM5\nM2\n"


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def write(name, text):
    Path(name).write_text(text, encoding="latin-1")
    return name


def verify(capsys, *words):
    """Exit code, the rows of the summary by their labels, the findings by line, and the error."""
    code = main(["verify", *words])
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    page = {
        line[:10].strip(): line[10:].strip() for line in lines if not re.match(r"\S+ line ", line)
    }
    return code, page, [line for line in lines if re.match(r"\S+ line ", line)], printed.err


def test_a_sound_program_has_no_finding_and_needs_no_post(capsys):
    code, page, findings, error = verify(capsys, write("shop.mod", RAPID))
    assert (code, findings, error) == (0, [], "")
    assert page["straight"] == "200.0 mm"
    assert page["output"] == "doGun: 1, 0"
    assert "diReady" in page["assumed"]
    assert page["language"].startswith("ABB RAPID")


def test_assumed_values_and_the_entry_change_the_run(capsys):
    write("shop.mod", RAPID)
    assert verify(capsys, "shop.mod", "--assume", "diReady=0")[1]["straight"] == "150.0 mm"
    assert verify(capsys, "shop.mod", "--entry", "other")[1]["program"].endswith("1 joint motion")


def test_joint_values_become_poses_with_the_arm_of_the_program(capsys):
    joints = "MoveAbsJ [[0,20,10,0,60,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v500,fine,tGun;"
    shifted = "MoveL Offs(CRobT(\\Tool:=tGun\\WObj:=wobj0),0,0,50),v100,fine,tGun;"
    program = write(
        "shop.mod", RAPID.replace("MoveJ p1,v500,fine,tGun;", f"{joints}\n{shifted}", 1)
    )
    main(["verify", program])
    assert "motions from there are shown in a frame of that name" in capsys.readouterr().out
    assert main(["verify", program, "--set", "operation.taught_on=abb_irb120"]) == 0
    printed = capsys.readouterr().out
    assert "left out" not in printed
    assert "in a frame of that name" not in printed
    code, _, _, error = verify(capsys, program, "--set", "operation.taught_on=nobody")
    assert code == 2
    assert "operation.taught_on" in error


def test_an_output_in_a_corner_is_dangerous(capsys):
    text = RAPID.replace("Offs(p1,0,100,0),v100,fine", "Offs(p1,0,100,0),v100,z10")
    code, _, findings, error = verify(capsys, write("shop.mod", text))
    assert code == 3
    assert [line.split(": ")[:2] for line in findings] == [["shop.mod line 7", "dangerous"]]
    assert "1 line is dangerous, first: doGun" in error


def test_a_subroutine_runs_with_the_arguments_of_the_user(capsys):
    text = "G21 G90\no<hole> sub\nG0 X#1 Y#2\nG0 Z5\nG1 Z[-#3] F100\no<hole> endsub\n"
    words = ("--entry", "hole", "--assume", "args=[10, 20,3]")
    code, page, findings, error = verify(capsys, write("hole.ngc", text), *words)
    assert (code, findings, error) == (0, [], "")
    assert page["extents"] == "x 10 to 10, y 20 to 20, z -3 to 5 mm"


def test_a_refused_line_decides_the_exit_code(capsys):
    text = RAPID.replace("[0,0,1,0],[0,0,0,0]", "[0,0,0.9,0],[0,0,0,0]").replace(
        "v100,fine", "v100,z10", 1
    )
    code, _, findings, error = verify(capsys, write("shop.mod", text))
    assert code == 2
    assert any(": refused: " in line for line in findings)
    assert "refused, first:" in error


def test_a_finding_has_the_line_of_its_file(capsys):
    bad = "MoveL [[0,0,0],[0.9,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v5,fine,tGun;"
    other = f"MODULE more\n  PROC extra()\n    {bad}\n  ENDPROC\nENDMODULE\n"
    text = RAPID.replace("    SetDO doGun,0;\n", "    extra;\n    SetDO doGun,0;\n")
    code, _, findings, _ = verify(capsys, write("shop.mod", text), write("more.mod", other))
    assert code == 2
    assert any(line.startswith("more.mod line 3: refused") for line in findings)


def test_lines_in_the_text_of_a_finding_have_their_file(capsys):
    later_routine = "  PROC later()\n    SetDO doLate,1;\n    SetDO doLate,0;\n  ENDPROC\n"
    text = RAPID.replace("  PROC other()", f"{later_routine}  PROC other()").replace(
        "    SetDO doGun,0;\n", "    extra;\n", 1
    )
    move = "MoveL Offs(p1,0,0,9),v50,z50,tGun;"
    other = f"MODULE more\n  PROC extra()\n    {move}\n    later;\n  ENDPROC\nENDMODULE\n"
    _, _, findings, _ = verify(capsys, write("shop.mod", text), write("more.mod", other))
    assert any("the motion in more.mod line 3 blends" in line for line in findings)


def test_findings_are_printed_as_json(capsys):
    write("shop.mod", RAPID.replace("Offs(p1,0,100,0),v100,fine", "Offs(p1,0,100,0),v100,z10"))
    assert main(["verify", "shop.mod", "--json"]) == 3
    data = json.loads(capsys.readouterr().out)
    assert [(fault["place"], fault["level"]) for fault in data["faults"]] == [
        ("shop.mod line 7", "dangerous")
    ]
    assert data["assumed"][0]["key"] == "diready"
    assert data["stopped"] is None


def test_the_page_shows_motion_text_and_findings(capsys):
    text = RAPID.replace("Offs(p1,0,100,0),v100,fine", "Offs(p1,0,100,0),v100,z10")
    assert main(["verify", write("shop.mod", text), "--report", "out.html"]) == 3
    capsys.readouterr()
    page = Path("out.html").read_text()
    data = json.loads(re.search(r'<script[^>]* id="data"[^>]*>(.*?)</script>', page, re.S)[1])
    assert data["listing"]["files"] == [["shop.mod", text]]
    assert [(note[0], note[7]) for note in data["notes"]] == [("dangerous", 7), ("assumed", 8)]
    assert [switch[1:] for switch in data["switches"]] == [["doGun", 1.0], ["doGun", 0.0]]
    # The output is set after the first line of 100 mm at 100 mm/s.
    assert data["switches"][0][0] == pytest.approx(1.0)
    assert len(data["paths"]) == 1
    assert ["Tool", "tGun: 0 0 200 0 0 0"] in data["facts"]


def test_a_program_without_a_motion_has_a_page(capsys):
    text = "MODULE a\n  PROC main()\n    SetDO doGun,1;\n    SetDO doGun,0;\n  ENDPROC\nENDMODULE\n"
    assert main(["verify", write("a.mod", text), "--report", "a.html"]) == 0
    assert Path("a.html").stat().st_size > 100_000
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--assume", "di1"], "'di1' is not a name with a value"),
        (["--assume", "=1"], "'=1' is not a name with a value"),
        (["--assume", "args=[1,]"], "'args[2]='"),
        (["--dialect", "fanuc"], "rapid has no dialect fanuc"),
        (["--report", "out.pdf"], "the report of a program is a page"),
        (["--report", "shop.mod.html/x.html"], "shop.mod.html"),
        (["--points", "job.toml"], "rapid has its locations in its text"),
        (["--entry", "nowhere"], "there is no PROC nowhere"),
        (
            ["--post", "rapid", "--job", "job.toml", "--assume", "di1=1"],
            "is for programs that camgen did not plan",
        ),
        (["--job", "job.toml"], "--post: is not given"),
    ],
)
def test_wrong_words_are_refused_in_one_line(capsys, words, message):
    write("job.toml", "")
    write("shop.mod", RAPID)
    code, _, _, error = verify(capsys, "shop.mod", *words)
    assert code == 2
    assert message in error
    assert error.count("\n") == 1


def test_the_error_of_a_text_of_no_language_lists_the_posts(capsys):
    code, _, _, error = verify(capsys, write("a.bin", "hello there\n"))
    assert code == 2
    assert "--post" in error
    assert "rapid" in error


def test_twenty_thousand_findings_are_listed(capsys):
    """With work that grows with the square of the findings the test would take minutes."""
    bad = "    MoveL [[1,2,3],[0.9,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v5,fine,tGun;\n"
    text = RAPID.replace("    SetDO doGun,0;\n", bad * 20_000)
    code, _, findings, _ = verify(capsys, write("shop.mod", text))
    assert code == 2
    assert len(findings) >= 20_000


def test_control_characters_of_a_file_do_not_reach_the_terminal(capsys):
    text = "Sub Main\n  \x1b[2J = 3\n  Move \x07x\nEnd Sub\n"
    assert main(["verify", write("a.pcs", text)]) == 2
    printed = capsys.readouterr()
    assert "[2J = 3 is not understood" in printed.out
    assert not any(ord(letter) < 32 and letter != "\n" for letter in printed.out + printed.err)


def make_glue_program(*, question: str = "", last_off: str = "    SetDO doGlue,0;\n") -> str:
    """Three straight paths in RAPID with an output on.

    question: statements before the first motion.
    last_off: statement after the third path.
    """
    motions = question
    for x in (0, 50, 100):
        motions += f"    MoveJ Offs(p1,{x},0,50),v500,fine,tGun;\n"
        motions += f"    MoveL Offs(p1,{x},0,0),v50,fine,tGun;\n    SetDO doGlue,1;\n"
        motions += f"    MoveL Offs(p1,{x},80,0),v50,fine,tGun;\n"
        motions += last_off if x == 100 else "    SetDO doGlue,0;\n"
    head, _, _ = RAPID.partition("    MoveJ p1")
    return f"{head}{motions}    MoveJ Offs(p1,0,0,90),v500,fine,tGun;\n  ENDPROC\nENDMODULE\n"


def test_an_output_that_stays_on_is_exit_code_3(capsys):
    assert verify(capsys, write("glue.mod", make_glue_program()))[::2] == (0, [])
    code, _, lines, error = verify(capsys, write("glue.mod", make_glue_program(last_off="")))
    assert code == 3
    assert "doGlue is still on at the end" in "".join(lines)
    assert "dangerous" in error


def test_a_danger_under_an_assumption_is_unusual(capsys):
    question = "    IF diReady=0 THEN\n      Stop;\n    ENDIF\n"
    code, page, lines, error = verify(
        capsys, write("glue.mod", make_glue_program(question=question, last_off=""))
    )
    assert "diReady" in page["assumed"]
    assert (code, error) == (0, "")
    assert [line for line in lines if line.endswith("at the end, if all is as assumed")]


def test_frames_of_the_header_that_differ_from_the_program_are_reported(capsys):
    header = "! work frame: 1 2 3 0 0 0\n! tool: diameter 6 mm - frame 0 0 210 0 0 0\n"
    _, _, lines, _ = verify(capsys, write("glue.mod", header + make_glue_program()))
    assert lines == [
        "glue.mod line 1: unusual: the header says work frame 1 2 3 0 0 0, "
        "the program sets 0 0 0 0 0 0",
        "glue.mod line 2: unusual: the header says tool frame 0 0 210 0 0 0, "
        "the program sets 0 0 200 0 0 0",
    ]


def test_a_program_of_functions_alone_has_no_finding(capsys):
    """DENSO keeps functions and data in files whose Main is empty."""
    text = "Public distance(20) As Double\n\nSub Main\n\nEnd Sub\n"
    code, page, lines, error = verify(capsys, write("data.pcs", text))
    assert (code, lines, error) == (0, [], "")
    assert page["program"].endswith("no instruction")


START = "G21 G90\nG0 X0 Y0 Z5\nF100\n#100=0\n"
COUNTING = f"{START}o1 while [1 EQ 1]\nG1 X[#100]\n#100=[#100+1]\no1 endwhile\nM2\n"


def test_a_limit_of_steps_is_possible_if_an_input_may_end_the_loop(capsys):
    waiting = COUNTING.replace("[1 EQ 1]", "[#5399 EQ 0]").replace("G1 X", "M66 P0 L0\nG1 X")
    limit = ["--set", "limits.gcode_steps=200"]
    code, page, lines, error = verify(capsys, write("wait.ngc", "M66 P0 L0\n" + waiting), *limit)
    assert (code, error) == (0, "")
    assert "din0" in page["assumed"]
    (line,) = lines
    assert ": possible: the run stops here: the program has not ended after 200 steps" in line
    assert line.endswith(", if all is as assumed")
    assert page["motion"] == "not proven: the run does not come to the end"
    code, page, lines, error = verify(capsys, write("count.ngc", COUNTING), *limit)
    assert code == 2
    assert "cannot be run to its end: the program has not ended after 200 steps" in error
    assert page["coverage"] == "8 of 9 statements run (88 %), not run: count.ngc line 9"


def test_the_coverage_is_printed_as_json(capsys):
    code = main(["verify", write("shop.mod", RAPID), "--json"])
    assert code == 0
    # All lines of main run, except for ELSE and ENDIF; the motion of the other routine does not.
    assert json.loads(capsys.readouterr().out)["coverage"] == {"statements": 8, "run": 7}


def test_a_refused_program_is_not_compared_with_its_drawing(capsys):
    part = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
    text = SQUARE.replace("X10\n", "X10 P5 P6\n")
    code, page, _, _ = verify(capsys, write("square.ngc", text), "--part", str(part))
    assert code == 2
    assert page["motion"] == "not proven: the program has lines to correct first"
    assert page["reach"].startswith("not proven: verify examines the text")
