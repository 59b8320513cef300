"""A URDF that is damaged or does not describe an arm is refused in one line with the place."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.cli import main
from camgen.model.errors import CamgenError
from camgen.model.job_tables import split_name
from camgen.robots.catalogue import find_robot

ROBOTS = Path(__file__).parents[2] / "fixtures" / "robots"
COBOT = (ROBOTS / "cobot.urdf").read_text()
#: The smallest arm that is accepted.
SMALLEST_ARM = (
    '<robot name="a"><link name="b"/><link name="c"/><joint name="j" type="revolute">'
    '<parent link="b"/><child link="c"/><origin xyz="0 0 0.1" rpy="0 0 0"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1" velocity="2"/></joint></robot>'
)
SECOND = '<joint name="k" type="fixed"><parent link="{}"/><child link="{}"/></joint></robot>'
BOMB = (
    '<?xml version="1.0"?><!DOCTYPE lolz [<!ENTITY a "lol">'
    '<!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">'
    '<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">'
    '<!ENTITY d "&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;">]><robot name="&d;"/>'
)
OUTSIDE = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/hostname">]><robot name="&x;"/>'


def change(old: str, new: str, text: str = SMALLEST_ARM) -> str:
    assert old in text
    return text.replace(old, new, 1)


def write_arm(folder: Path, text: str = SMALLEST_ARM, name: str = "arm.urdf") -> Path:
    """A file with the text of an arm."""
    (folder / name).write_text(text)
    return folder / name


def add_elements(*parts: str) -> str:
    """The smallest arm with further elements."""
    return change("</robot>", "".join(parts) + "</robot>")


BAD = {
    "empty": ("", "is not XML: no element found (line 1, column 0)"),
    "cut": (
        SMALLEST_ARM[:100],
        f"is not XML: unclosed token (line 1, column {SMALLEST_ARM[:100].rfind(chr(60))})",
    ),
    "text": ("a robot", "is not XML: syntax error (line 1, column 0)"),
    "bomb": (BOMB, "declares a DOCTYPE, which a URDF does not need; remove it"),
    "outside": (OUTSIDE, "declares a DOCTYPE, which a URDF does not need; remove it"),
    "sdf": ("<sdf/>", "describes no robot: its root is sdf"),
    "nothing": ("<robot/>", "has no links"),
    "encoding": (
        '<?xml version="1.0" encoding="klingon"?><robot/>',
        "is not XML: unknown encoding: klingon; save it as UTF-8",
    ),
    "still": (
        '<robot><link name="b"/></robot>',
        "nothing moves between b and b; name another tip: FILE.urdf#LINK",
    ),
    "xacro": (
        '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="a"/></robot>',
        "is xacro, from which a URDF is made; expand it: xacro arm.xacro > arm.urdf",
    ),
    "loop": (
        add_elements(
            '<link name="d"/><link name="e"/>',
            SECOND.format("d", "e")[:-8],
            '<joint name="l" type="fixed"><parent link="e"/><child link="d"/></joint>',
        ),
        "links form a loop, or are below one: d, e; "
        "remove a joint of the loop: camgen cannot move loops",
    ),
    "all in a loop": (
        change("</robot>", SECOND.format("c", "b")),
        "links form a loop, or are below one: b, c; "
        "remove a joint of the loop: camgen cannot move loops",
    ),
    "itself": (
        add_elements('<link name="d"/>', SECOND.format("d", "d")[:-8]),
        "links form a loop, or are below one: d; "
        "remove a joint of the loop: camgen cannot move loops",
    ),
    "two parents": (
        add_elements(
            '<link name="d"/>',
            SECOND.format("b", "d")[:-8],
            SECOND.format("c", "d").replace('"k"', '"m"')[:-8],
        ),
        "link d is the child of two joints (joints k and m); "
        "remove one of them: camgen cannot move loops",
    ),
    "two roots": (
        add_elements('<link name="d"/>'),
        "has 2 roots: b, d; connect them by joints, or remove all but one",
    ),
    "two links": (add_elements('<link name="c"/>'), "there are two links c; rename one"),
    "two joints": (
        add_elements('<link name="d"/>', SECOND.format("c", "d").replace('"k"', '"j"')[:-8]),
        "there are two joints j; rename one",
    ),
    "no link": (change('child link="c"', 'child link="x"'), "there is no link x (joint j)"),
    "no name": (change('<link name="c"/>', "<link/>"), 'link has no name; give it name="..."'),
    "long name": (
        change('joint name="j"', f'joint name="{"j" * 600}"'),
        f"joint {'j' * 20}... has a name of 600 letters; shorten it",
    ),
    "bell": (
        change('joint name="j"', 'joint name="j&#x9b;2J"'),
        "joint has a name that cannot be printed; rename it",
    ),
    "no type": (change(' type="revolute"', ""), 'joint has no type (joint j); give it type="..."'),
    "type": (
        change("revolute", "screw"),
        '"screw" is not a type of joint (joint j); '
        "known are revolute, continuous, prismatic, fixed, floating, planar",
    ),
    "floating": (
        change("revolute", "floating"),
        "an arm cannot have a floating joint (joint j); make it fixed, or name another tip",
    ),
    "planar": (
        change("revolute", "planar"),
        "an arm cannot have a planar joint (joint j); make it fixed, or name another tip",
    ),
    "no parent": (
        change('<parent link="b"/>', ""),
        'it has no parent (joint j); give it <parent link="..."/>',
    ),
    "mimic": (
        change("</joint>", '<mimic joint="q"/></joint>'),
        "it follows joint q (mimic) (joint j); "
        "camgen moves each joint by itself: use a built-in robot",
    ),
    "nan": (change("0 0 0.1", "0 0 nan"), '"nan" is not a number (joint j, xyz)'),
    "inf": (change('upper="1"', 'upper="inf"'), '"inf" is not a number (joint j, limit, upper)'),
    "far": (
        change("0 0 0.1", "0 0 1e300"),
        "1e300 is beyond all measure (joint j, xyz); lengths are m, angles rad",
    ),
    "huge": (
        change("0 0 0.1", "0 0 1e999"),
        "1e999 is beyond all measure (joint j, xyz); lengths are m, angles rad",
    ),
    "comma": (change("0 0 0.1", "0,0,0.1"), "three numbers are needed, not 1 (joint j, xyz)"),
    "two numbers": (
        change('rpy="0 0 0"', 'rpy="0 0"'),
        "three numbers are needed, not 2 (joint j, rpy)",
    ),
    "no numbers": (
        change('rpy="0 0 0"', 'rpy=""'),
        "three numbers are needed, not 0 (joint j, rpy)",
    ),
    "underscore": (change("0 0 0.1", "0 0 1_0"), '"1_0" is not a number (joint j, xyz)'),
    "other digits": (change("0 0 0.1", "0 0 ٣"), '"٣" is not a number (joint j, xyz)'),
    "formula": (change("0 0 0.1", "0 0 ${h}"), '"${h}" is not a number (joint j, xyz)'),
    "no axis": (
        change("0 0 1", "0 0 0"),
        "the axis has no direction (joint j); give axis xyz, of length 1",
    ),
    "no limit": (
        change('<limit lower="-1" upper="1" velocity="2"/>', ""),
        'it states no speed (joint j); give <limit velocity="..."/>, rad/s',
    ),
    "no limits": (
        change('lower="-1" upper="1"', ""),
        'it states no limits (joint j); give <limit lower="..." upper="..."/>, rad',
    ),
    "half a limit": (
        change('lower="-1"', ""),
        'it states no limits (joint j); give <limit lower="..." upper="..."/>, rad',
    ),
    "no speed": (
        change('velocity="2"', 'velocity="0"'),
        'it states no speed (joint j); give <limit velocity="..."/>, rad/s',
    ),
    "no room": (
        change('lower="-1" upper="1"', 'lower="0" upper="0"'),
        "its limits leave no range: 0 to 0 rad (joint j); "
        'correct the limits, or make it type="fixed"',
    ),
    "crossed": (
        change('lower="-1"', 'lower="2"').replace("revolute", "prismatic"),
        "its limits leave no range: 2000 to 1000 mm (joint j); "
        'correct the limits, or make it type="fixed"',
    ),
    "many turns": (
        change('upper="1"', 'upper="9000"'),
        'a limit is more than four turns from 0 (joint j); make it type="continuous"',
    ),
    "shape": (
        change('<link name="c"/>', '<link name="c"><visual/></link>'),
        "visual needs one shape, box, cylinder, sphere, mesh (link c)",
    ),
    "flat": (
        change(
            '<link name="c"/>',
            '<link name="c"><visual><geometry><sphere radius="0"/></geometry></visual></link>',
        ),
        "a sphere has no size (link c); give lengths above 0, m",
    ),
    "box": (
        change(
            '<link name="c"/>',
            '<link name="c"><visual><geometry><box size="1 2"/></geometry></visual></link>',
        ),
        "three numbers are needed, not 2 (link c, box, size)",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_refused_in_one_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, expected = BAD[name]
    file = write_arm(tmp_path, text)
    assert main(["robots", str(file)]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err == f"camgen: error: {file}: {expected}\n"


def test_the_smallest_arm_has_one_joint(tmp_path: Path) -> None:
    assert len(find_robot(str(write_arm(tmp_path))).joints) == 1


def test_a_doctype_is_found_in_every_encoding(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    for encoding in ("utf-16", "utf-8-sig"):
        file.write_bytes(BOMB.removeprefix('<?xml version="1.0"?>').encode(encoding))
        with pytest.raises(CamgenError, match="declares a DOCTYPE"):
            find_robot(str(file))
        file.write_bytes(SMALLEST_ARM.encode(encoding))
        assert find_robot(str(file)).name == "a"


def test_a_name_that_is_not_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        CamgenError,
        match=r"none\.urdf: no such file \(cell\.robot\); a job file names it from its own",
    ):
        find_robot(str(tmp_path / "none.urdf"))
    folder = tmp_path / "folder.urdf"
    folder.mkdir()
    with pytest.raises(CamgenError, match=r"folder\.urdf: is not a file"):
        find_robot(str(folder))
    with pytest.raises(CamgenError, match="cannot be read: embedded null"):
        find_robot("a\0.urdf")
    pipe = tmp_path / "pipe.urdf"
    os.mkfifo(pipe)
    with pytest.raises(CamgenError, match=r"pipe\.urdf: is not a file"):
        find_robot(str(pipe))


def test_a_file_too_large_is_not_read(tmp_path: Path) -> None:
    file = tmp_path / "large.urdf"
    with file.open("wb") as stream:
        stream.truncate(8_000_001)
    with pytest.raises(
        CamgenError, match="has more than 8,000,000 bytes: no description of a robot"
    ):
        find_robot(str(file))


def test_xacro_is_refused_by_name(tmp_path: Path) -> None:
    file = write_arm(tmp_path, "<robot><xacro:macro/></robot>", "arm.urdf.xacro")
    with pytest.raises(
        CamgenError,
        match=r"is xacro, from which a URDF is made; expand it: xacro arm\.xacro > arm\.urdf",
    ):
        find_robot(str(file))


def test_an_unknown_tip_is_refused_with_the_known_links(tmp_path: Path) -> None:
    with pytest.raises(CamgenError, match=r"there is no link gripper; there are b, c$"):
        find_robot(f"{write_arm(tmp_path)}#gripper")


def test_deep_and_wide_files_are_refused_without_delay(tmp_path: Path) -> None:
    deep = write_arm(tmp_path, "<robot>" + "<a>" * 50_000 + "</a>" * 50_000 + "</robot>")
    with pytest.raises(CamgenError, match="has no links"):
        find_robot(str(deep))
    names = [f"l{k}" for k in range(10_000)]
    joints = [
        f'<joint name="j{k}" type="fixed"><parent link="l{k}"/><child link="l{k + 1}"/></joint>'
        for k in range(9_999)
    ]
    long = tmp_path / "long.urdf"
    long.write_text(
        "<robot>"
        + "".join(f'<link name="{name}"/>' for name in names)
        + "".join(joints)
        + "</robot>"
    )
    with pytest.raises(CamgenError, match="nothing moves between l0 and l9999"):
        find_robot(str(long))


@pytest.mark.parametrize("count", [13, 8])
def test_an_arm_with_too_many_joints_or_turns_is_refused(count: int, tmp_path: Path) -> None:
    links = "".join(f'<link name="l{k}"/>' for k in range(count + 1))
    joints = "".join(
        f'<joint name="j{k}" type="continuous"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0.1 0 0"/><axis xyz="0 {k % 2} 1"/><limit velocity="1"/></joint>'
        for k in range(count)
    )
    file = write_arm(tmp_path, f"<robot>{links}{joints}</robot>", "snake.urdf")
    expected = {
        13: "has 13 joints between l0 and l13, 12 at most",
        8: "its joints can make too many whole turns",
    }
    with pytest.raises(CamgenError, match=expected[count]):
        find_robot(str(file))


@given(data=st.data())
def test_a_damaged_file_is_an_arm_or_is_refused_in_one_line(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    raw = bytearray(COBOT.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        position = data.draw(st.integers(0, len(raw) - 1))
        kind = data.draw(st.sampled_from(["set", "cut", "drop"]))
        if kind == "set":
            raw[position] = data.draw(st.integers(0, 255))
        elif kind == "cut":
            del raw[position : position + data.draw(st.integers(1, 200))]
        else:
            del raw[position]
    file = tmp_path_factory.getbasetemp() / "damaged.urdf"
    file.write_bytes(bytes(raw))
    message = find_refusal(file)
    assert message is None or (message.startswith(str(file)) and "\n" not in message)


def find_refusal(file: Path) -> str | None:
    try:
        find_robot(str(file))
    except CamgenError as error:
        return str(error)
    return None


def test_the_name_of_a_file_is_split_from_the_name_of_its_tip() -> None:
    assert split_name("a/b.urdf") == ("a/b.urdf", "")
    assert split_name("a#b.urdf") == ("a#b.urdf", "")
    assert split_name("a#b.urdf#c#d") is None
    assert split_name("a.urdf#flange") == ("a.urdf", "flange")
    assert split_name("IRB 2400") is None
    assert split_name("") is None
