"""``camgen verify`` on programs of others: three levels, what is assumed, what the user says, the page."""

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


def judged(capsys, *words):
    """Exit code, the page by its labels, the lines about lines, and the error."""
    code = main(["verify", *words])
    shown = capsys.readouterr()
    lines = shown.out.splitlines()
    page = {
        line[:10].strip(): line[10:].strip() for line in lines if not re.match(r"\S+ line ", line)
    }
    return code, page, [line for line in lines if re.match(r"\S+ line ", line)], shown.err


def test_a_sound_program_has_no_finding_and_needs_no_post(capsys):
    code, page, told, error = judged(capsys, write("shop.mod", RAPID))
    assert (code, told, error) == (0, [], "")
    assert page["straight"] == "200.0 mm"
    assert page["output"] == "doGun: 1, 0"
    assert "diReady" in page["assumed"]
    assert page["language"].startswith("ABB RAPID")


def test_what_the_user_says_leads_elsewhere(capsys):
    write("shop.mod", RAPID)
    assert judged(capsys, "shop.mod", "--assume", "diReady=0")[1]["straight"] == "150.0 mm"
    assert judged(capsys, "shop.mod", "--entry", "other")[1]["program"].endswith("1 joint motion")


def test_the_arm_that_a_program_is_for_tells_where_joint_values_lead(capsys):
    joints = "MoveAbsJ [[0,20,10,0,60,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v500,fine,tGun;"
    seen = "MoveL Offs(CRobT(\\Tool:=tGun\\WObj:=wobj0),0,0,50),v100,fine,tGun;"
    program = write("shop.mod", RAPID.replace("MoveJ p1,v500,fine,tGun;", f"{joints}\n{seen}", 1))
    main(["verify", program])
    assert "motions from there are shown in a frame of that name" in capsys.readouterr().out
    assert main(["verify", program, "--set", "operation.taught_on=abb_irb120"]) == 0
    shown = capsys.readouterr().out
    assert "left out" not in shown
    assert "in a frame of that name" not in shown
    code, _, _, error = judged(capsys, program, "--set", "operation.taught_on=nobody")
    assert code == 2
    assert "operation.taught_on" in error


def test_an_output_in_a_corner_is_dangerous(capsys):
    text = RAPID.replace("Offs(p1,0,100,0),v100,fine", "Offs(p1,0,100,0),v100,z10")
    code, _, told, error = judged(capsys, write("shop.mod", text))
    assert code == 3
    assert [line.split(": ")[:2] for line in told] == [["shop.mod line 7", "dangerous"]]
    assert "1 line is dangerous, first: doGun" in error


def test_a_subroutine_runs_with_the_arguments_of_the_user(capsys):
    text = "G21 G90\no<hole> sub\nG0 X#1 Y#2\nG0 Z5\nG1 Z[-#3] F100\no<hole> endsub\n"
    words = ("--entry", "hole", "--assume", "args=[10, 20,3]")
    code, page, findings, error = judged(capsys, write("hole.ngc", text), *words)
    assert (code, findings, error) == (0, [], "")
    assert page["extents"] == "x 10 to 10, y 20 to 20, z -3 to 5 mm"


def test_what_the_controller_refuses_comes_first(capsys):
    text = RAPID.replace("[0,0,1,0],[0,0,0,0]", "[0,0,0.9,0],[0,0,0,0]").replace(
        "v100,fine", "v100,z10", 1
    )
    code, _, told, error = judged(capsys, write("shop.mod", text))
    assert code == 2
    assert any(": refused: " in line for line in told)
    assert "refused, first:" in error


def test_the_place_is_that_of_the_file(capsys):
    bad = "MoveL [[0,0,0],[0.9,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v5,fine,tGun;"
    other = f"MODULE more\n  PROC extra()\n    {bad}\n  ENDPROC\nENDMODULE\n"
    text = RAPID.replace("    SetDO doGun,0;\n", "    extra;\n    SetDO doGun,0;\n")
    code, _, told, _ = judged(capsys, write("shop.mod", text), write("more.mod", other))
    assert code == 2
    assert any(line.startswith("more.mod line 3: refused") for line in told)


def test_lines_in_texts_name_their_file_too(capsys):
    late = "  PROC later()\n    SetDO doLate,1;\n    SetDO doLate,0;\n  ENDPROC\n"
    text = RAPID.replace("  PROC other()", f"{late}  PROC other()").replace(
        "    SetDO doGun,0;\n", "    extra;\n", 1
    )
    move = "MoveL Offs(p1,0,0,9),v50,z50,tGun;"
    other = f"MODULE more\n  PROC extra()\n    {move}\n    later;\n  ENDPROC\nENDMODULE\n"
    _, _, told, _ = judged(capsys, write("shop.mod", text), write("more.mod", other))
    assert any("the motion in more.mod line 3 blends" in line for line in told)


def test_it_is_said_as_data(capsys):
    write("shop.mod", RAPID.replace("Offs(p1,0,100,0),v100,fine", "Offs(p1,0,100,0),v100,z10"))
    assert main(["verify", "shop.mod", "--json"]) == 3
    found = json.loads(capsys.readouterr().out)
    assert [(one["place"], one["level"]) for one in found["faults"]] == [
        ("shop.mod line 7", "dangerous")
    ]
    assert found["assumed"][0]["key"] == "diready"
    assert found["stopped"] is None


def test_the_page_shows_motion_text_and_findings(capsys):
    text = RAPID.replace("Offs(p1,0,100,0),v100,fine", "Offs(p1,0,100,0),v100,z10")
    assert main(["verify", write("shop.mod", text), "--report", "out.html"]) == 3
    capsys.readouterr()
    page = Path("out.html").read_text()
    data = json.loads(re.search(r'<script[^>]* id="data"[^>]*>(.*?)</script>', page, re.S)[1])
    assert data["listing"]["files"] == [["shop.mod", text]]
    assert [(note[0], note[7]) for note in data["notes"]] == [("dangerous", 7), ("assumed", 8)]
    assert [one[1:] for one in data["switches"]] == [["doGun", 1.0], ["doGun", 0.0]]
    # 600 mm from above: 100 mm at 100 mm/s from the first target on.
    assert data["switches"][0][0] == pytest.approx(1.0)
    assert len(data["paths"]) == 1
    assert ["Tool", "tGun: 0 0 200 0 0 0"] in data["facts"]


def test_a_program_without_a_motion_has_a_page_too(capsys):
    text = "MODULE a\n  PROC main()\n    SetDO doGun,1;\n    SetDO doGun,0;\n  ENDPROC\nENDMODULE\n"
    assert main(["verify", write("a.mod", text), "--report", "a.html"]) == 0
    assert Path("a.html").stat().st_size > 100_000
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "said"),
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
def test_what_makes_no_sense_is_one_line(capsys, words, said):
    write("job.toml", "")
    write("shop.mod", RAPID)
    code, _, _, error = judged(capsys, "shop.mod", *words)
    assert code == 2
    assert said in error
    assert error.count("\n") == 1


def test_a_text_of_no_language_is_told_what_there_is(capsys):
    code, _, _, error = judged(capsys, write("a.bin", "hello there\n"))
    assert code == 2
    assert "--post" in error
    assert "rapid" in error


def test_twenty_thousand_findings_take_no_quadratic_time(capsys):
    bad = "    MoveL [[1,2,3],[0.9,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v5,fine,tGun;\n"
    text = RAPID.replace("    SetDO doGun,0;\n", bad * 20_000)
    code, _, told, _ = judged(capsys, write("shop.mod", text))
    assert code == 2
    assert len(told) >= 20_000


def test_nothing_in_a_file_reaches_the_terminal_as_an_order(capsys):
    text = "Sub Main\n  \x1b[2J = 3\n  Move \x07x\nEnd Sub\n"
    assert main(["verify", write("a.pcs", text)]) == 2
    shown = capsys.readouterr()
    assert "[2J = 3 is not understood" in shown.out
    assert not any(ord(letter) < 32 and letter != "\n" for letter in shown.out + shown.err)


def glue(*, ask: str = "", last_off: str = "    SetDO doGlue,0;\n") -> str:
    """Three straight paths in RAPID with an output on. ask: statement before the first motion."""
    motions = ask
    for x in (0, 50, 100):
        motions += f"    MoveJ Offs(p1,{x},0,50),v500,fine,tGun;\n"
        motions += f"    MoveL Offs(p1,{x},0,0),v50,fine,tGun;\n    SetDO doGlue,1;\n"
        motions += f"    MoveL Offs(p1,{x},80,0),v50,fine,tGun;\n"
        motions += last_off if x == 100 else "    SetDO doGlue,0;\n"
    head, _, _ = RAPID.partition("    MoveJ p1")
    return f"{head}{motions}    MoveJ Offs(p1,0,0,90),v500,fine,tGun;\n  ENDPROC\nENDMODULE\n"


def test_harm_in_the_motion_is_exit_3(capsys):
    assert judged(capsys, write("glue.mod", glue()))[::2] == (0, [])
    code, _, lines, error = judged(capsys, write("glue.mod", glue(last_off="")))
    assert code == 3
    assert "doGlue is still on at the end" in "".join(lines)
    assert "dangerous" in error


def test_harm_that_rests_on_an_assumption_is_unusual(capsys):
    ask = "    IF diReady=0 THEN\n      Stop;\n    ENDIF\n"
    code, page, lines, error = judged(capsys, write("glue.mod", glue(ask=ask, last_off="")))
    assert "diReady" in page["assumed"]
    assert (code, error) == (0, "")
    assert [line for line in lines if line.endswith("at the end, if all is as assumed")]


def test_a_header_that_names_another_frame(capsys):
    header = "! work frame: 1 2 3 0 0 0\n! tool: diameter 6 mm - frame 0 0 210 0 0 0\n"
    _, _, lines, _ = judged(capsys, write("glue.mod", header + glue()))
    assert lines == [
        "glue.mod line 1: unusual: the header says work frame 1 2 3 0 0 0, "
        "the program sets 0 0 0 0 0 0",
        "glue.mod line 2: unusual: the header says tool frame 0 0 210 0 0 0, "
        "the program sets 0 0 200 0 0 0",
    ]


def test_a_program_of_functions_alone_is_no_fault(capsys):
    """DENSO keeps functions and data in files whose Main is empty."""
    text = "Public distance(20) As Double\n\nSub Main\n\nEnd Sub\n"
    code, page, lines, error = judged(capsys, write("data.pcs", text))
    assert (code, lines, error) == (0, [], "")
    assert page["program"].endswith("no instruction")


START = "G21 G90\nG0 X0 Y0 Z5\nF100\n#100=0\n"
COUNTING = f"{START}o1 while [1 EQ 1]\nG1 X[#100]\n#100=[#100+1]\no1 endwhile\nM2\n"


def test_a_limit_of_steps_is_possible_if_an_input_may_end_the_loop(capsys):
    waiting = COUNTING.replace("[1 EQ 1]", "[#5399 EQ 0]").replace("G1 X", "M66 P0 L0\nG1 X")
    limit = ["--set", "limits.gcode_steps=200"]
    code, page, lines, error = judged(capsys, write("wait.ngc", "M66 P0 L0\n" + waiting), *limit)
    assert (code, error) == (0, "")
    assert "din0" in page["assumed"]
    (line,) = lines
    assert ": possible: the run stops here: the program has not ended after 200 steps" in line
    assert line.endswith(", if all is as assumed")
    assert page["motion"] == "not proven: the run does not come to the end"
    code, page, lines, error = judged(capsys, write("count.ngc", COUNTING), *limit)
    assert code == 2
    assert "cannot be run to its end: the program has not ended after 200 steps" in error
    assert page["coverage"] == "8 of 9 statements run (88 %), not run: count.ngc line 9"


def test_coverage_is_in_the_data(capsys):
    code = main(["verify", write("shop.mod", RAPID), "--json"])
    assert code == 0
    # The lines of main but ELSE and ENDIF run, and the motion of the other routine does not.
    assert json.loads(capsys.readouterr().out)["coverage"] == {"statements": 8, "run": 7}


def test_a_refused_program_is_not_compared_with_its_drawing(capsys):
    part = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
    text = SQUARE.replace("X10\n", "X10 P5 P6\n")
    code, page, _, _ = judged(capsys, write("square.ngc", text), "--part", str(part))
    assert code == 2
    assert page["motion"] == "not proven: the program has lines to correct first"
    assert page["reach"].startswith("not proven: verify examines the text")
