"""The tool of the controller that each program selects, and the frame that it must have there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import camgen
from camgen.cli import main
from camgen.model.errors import JobError

BRACKET = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
DRILL = {"kind": "drill", "tool": "drill 8", "depth": 10, "holes": [7.9, 8.1]}
OUTLINE = {"kind": "follow", "tool": "mill 6", "layers": ["OUTLINE"], "depth": 3}
SWITCHED = {
    "pacscript": {"signals": {"spindle": 24}, "spindle": "on-off"},
    "rapid": {"signals": {"spindle": "aoSpindle"}},
    "vplus": {"signals": {"spindle": 1}, "spindle": "on-off"},
}


def build(post: str, numbers: tuple[int, int] = (4, 7), **options: object) -> camgen.Result:
    """Two programs, for tools of 120 and of 80 mm."""
    drill = {"name": "drill 8", "kind": "drill", "diameter": 8, "length": 120, "feed": 3}
    mill = {"name": "mill 6", "diameter": 6, "length": 80, "feed": 20, "plunge": 5}
    tools = [drill | {"number": numbers[0]}, mill | {"number": numbers[1]}]
    job = {
        "tools": [tool | {"speed": 3000} for tool in tools],
        "operations": [DRILL, OUTLINE],
        "stock": {"thickness": 10},
        "post": SWITCHED[post] | options,
    }
    return camgen.build(BRACKET, post=post, job=job)


def test_each_pacscript_program_changes_to_its_tool() -> None:
    texts = [file.text for file in build("pacscript").files]
    assert [re.findall(r"ChangeTool (\d+)", text) for text in texts] == [["4"], ["7"]]
    for text, number, length in zip(texts, (4, 7), (120, 80), strict=True):
        order = f"' tool {number} must be set on the pendant to: 0.000, 0.000, {length}.000,"
        assert text.count(order) == 1
        assert text.count("' tool: ") == 1


def test_each_program_states_its_number_among_all() -> None:
    for post in SWITCHED:
        heads = [file.text for file in build(post).files]
        assert ["program 1 of 2" in head for head in heads] == [True, False]
        assert ["program 2 of 2" in head for head in heads] == [False, True]


@pytest.mark.parametrize(("numbers", "options"), [((0, 0), {}), ((4, 7), {"tool": 2})])
def test_two_frames_under_one_number_are_refused_with_both(
    numbers: tuple[int, int], options: dict[str, object]
) -> None:
    with pytest.raises(JobError, match=r"two frames: 0 0 120 .* 0 0 80 ") as caught:
        build("pacscript", numbers, **options)
    assert caught.value.exit_code == 2


def test_a_number_that_the_controller_does_not_have_is_refused() -> None:
    with pytest.raises(JobError, match="has the number 64"):
        build("pacscript", (4, 64))


def test_rapid_declares_each_tool_under_a_name_with_its_number() -> None:
    texts = [file.text for file in build("rapid").files]
    for text, name, length in zip(texts, ("tCamgen4", "tCamgen7"), (120, 80), strict=True):
        assert f"tooldata {name}:=[TRUE,[[0.000,0.000,{length}.000]" in text
        assert set(re.findall(r"\btCamgen\w*", text)) == {name}


def test_rapid_tools_without_numbers_are_declared_under_their_names() -> None:
    """Two modules that declare one name overwrite each other's frame."""
    texts = [file.text for file in build("rapid", (0, 0)).files]
    for text, name in zip(texts, ("tCamgen_drill_8", "tCamgen_mill_6"), strict=True):
        assert set(re.findall(r"\btCamgen\w*", text)) == {name}


def test_rapid_refuses_two_frames_under_one_name() -> None:
    with pytest.raises(JobError, match=r"tooldata tMine .* two frames: 0 0 120 .* 0 0 80 "):
        build("rapid", (4, 7), tool="tMine")


def test_rapid_names_the_tools_of_the_controller() -> None:
    with pytest.raises(JobError, match="'drill 8' is not a RAPID name"):
        build("rapid", declare=False)


def test_rapid_expects_frames_of_tools_that_it_does_not_declare() -> None:
    job = {
        "tools": [{"name": "tMill", "number": 1, "diameter": 6, "length": 90, "speed": 9000}],
        "operations": [OUTLINE | {"tool": "tMill"}],
        "post": SWITCHED["rapid"] | {"declare": False},
    }
    text = camgen.build(BRACKET, post="rapid", job=job).text
    assert "! tMill must be on the controller with the frame 0 0 90 0 0 0 mm, deg" in text
    assert ",tMill\\WObj" in text
    assert "tCamgen" not in text


def test_verify_knows_the_tool_of_each_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = [
        '[[tools]]\nname = "drill 8"\nnumber = 4\nkind = "drill"\ndiameter = 8\nlength = 120',
        "feed = 3\nspeed = 3000",
        '[[tools]]\nname = "mill 6"\nnumber = 7\ndiameter = 6\nlength = 80\nspeed = 9000',
        '[[operations]]\nkind = "drill"\ntool = "drill 8"\ndepth = 10\nholes = [7.9, 8.1]',
        '[[operations]]\nkind = "follow"\ntool = "mill 6"\nlayers = ["OUTLINE"]\ndepth = 3',
        '[post]\nsignals = {spindle = 24}\nspindle = "on-off"',
    ]
    Path("job.toml").write_text("\n".join(rows))
    command = ["--post", "pacscript", "--job", "job.toml"]
    assert main(["build", str(BRACKET), *command, "-q", "--plan", "plan.json"]) == 0
    for name in ("bracket_1.pcs", "bracket_2.pcs"):
        assert main(["verify", name, *command]) == 0
        assert "remark" not in capsys.readouterr().out
        assert main(["verify", name, "--post", "pacscript", "--plan", "plan.json"]) == 0
    text = Path("bracket_2.pcs").read_text()
    Path("bracket_2.pcs").write_text(text.replace("ChangeTool 7", "ChangeTool 4"))
    capsys.readouterr()
    assert main(["verify", "bracket_2.pcs", "--post", "pacscript", "--plan", "plan.json"]) == 2
    assert "tool 4 is on, by post.tool it is 7" in capsys.readouterr().err
