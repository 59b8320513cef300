"""Arms from URDF files have the frames, limits and joints that an independent reader finds."""

import math
from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.cli import main
from camgen.model.errors import CamgenError, NoSafeProgram
from camgen.pipeline import build
from camgen.read.files import Files
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics import iterative as damped
from camgen.robots.kinematics.arms import recognise_arm
from camgen.robots.kinematics.forward import compute_flange, compute_jacobian, compute_link_frames
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import are_within_limits
from camgen.robots.models import Robot
from camgen.robots.posture import compute_postures
from camgen.robots.urdf.xml import list_urdf_files
from tests.support.rounding import rounding_bound
from tests.support.urdf_arms import Arm, built_in, disguised, rpy, step, tip, turn, urdf

FIXTURES = Path(__file__).parents[2] / "fixtures"
SIX, COBOT = FIXTURES / "robots" / "six.urdf", FIXTURES / "robots" / "cobot.urdf"
KINDS = {
    "irb120": "spherical-wrist", "irb2400": "spherical-wrist", "vipers650": "spherical-wrist",
    "vs060": "spherical-wrist", "cobras600": "scara", "mill": "cartesian", "cobotta": "serial",
}  # fmt: skip
UP, LEFT, RIGHT = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)
#: The seven axes of a cobot whose elbow can swivel.
SEVEN = Arm(
    tuple(step((0, 0, z)) for z in (0.3, 0, 0.35, 0, 0.35, 0, 0.1)),
    tuple(np.array(axis) for axis in (UP, LEFT, UP, RIGHT, UP, LEFT, UP)),
    ("revolute",) * 7,
    ((-2.9, 2.9), (-2.0, 2.0)) * 3 + ((-3.0, 3.0),),
    (1.5,) * 7,
    step((0, 0, 0.12)),
)  # fmt: skip


def write_urdf(folder: Path, text: str, name: str = "arm.urdf") -> str:
    """The name of a file with this text."""
    file = folder / name
    file.write_text(text)
    return str(file)


def draw_joint_values(robot: Robot, count: int) -> np.ndarray:
    """Random joint values (count, J) within the limits of each joint."""
    return np.random.default_rng(3).uniform(
        robot.limits[:, 0], robot.limits[:, 1], (count, len(robot.joints))
    )


def metre_scale(robot: Robot) -> np.ndarray:
    """The factors (J,) from the units of camgen to those of a URDF, which has m and rad."""
    return np.array([1e-3 if joint.sliding else 1.0 for joint in robot.joints])


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("stem", KINDS)
def test_frames_limits_and_joints_are_those_of_the_text(
    stem: str, seed: int, tmp_path: Path
) -> None:
    """A seed above 0 gives the same arm with rotated joint frames and other zeros."""
    arm = disguised(built_in(stem), seed) if seed else built_in(stem)
    robot = find_robot(write_urdf(tmp_path, urdf(arm)))
    assert robot.limits * metre_scale(robot)[:, None] == pytest.approx(
        np.array(arm.limits), abs=1e-12
    )
    assert robot.speeds * metre_scale(robot) == pytest.approx(np.array(arm.speeds), abs=1e-12)
    joints = draw_joint_values(robot, 100)
    rotations, origins = compute_flange(robot, joints)
    for row, values in enumerate(joints * metre_scale(robot)):
        expected = tip(arm, values)
        assert np.abs(origins[row] - 1000 * expected[:3, 3]).max() < 1e-9
        assert np.abs(rotations[row] - expected[:3, :3]).max() < 1e-12
    assert robot.kind == KINDS[stem]
    if robot.arm is None:
        return
    solutions = compute_solutions(robot, rotations, origins)
    counts = {"spherical-wrist": {4, 8}, "scara": {2}, "cartesian": {1}}[robot.kind]
    assert set(np.isfinite(solutions[:, :, 0]).sum(axis=1).tolist()) <= counts
    sliding = np.array([joint.sliding for joint in robot.joints])
    differences = solutions - joints[:, None]
    differences = np.abs(
        np.where(sliding, differences, np.remainder(differences + math.pi, math.tau) - math.pi)
    ).max(axis=2)
    assert np.nanmin(differences, axis=1).max() < 1e-6
    for row, column in np.argwhere(np.isfinite(solutions[:, :, 0])):
        reached = tip(arm, solutions[row, column] * metre_scale(robot))
        assert np.abs(1000 * reached[:3, 3] - origins[row]).max() < 1e-6
        assert np.abs(reached[:3, :3] - rotations[row]).max() < 1e-9


def test_a_built_in_robot_written_as_urdf_is_that_robot(tmp_path: Path) -> None:
    """With all joints at 0 the flange of the IRB 120 is 374 mm ahead at 630 mm (data sheet)."""
    robot = find_robot(write_urdf(tmp_path, urdf(built_in("irb120"), "my arm")))
    built = find_robot("IRB 120")
    assert compute_flange(robot, np.zeros((1, 6)))[1][0] == pytest.approx([374, 0, 630], abs=1e-9)
    assert robot.name == "my arm"
    assert robot.limits == pytest.approx(built.limits)
    assert robot.home == pytest.approx(built.home)
    assert robot.links[0].name == "base_link"
    assert [link.name for link in robot.links[1:]] == [f"link_{k}" for k in range(1, 7)]


def test_a_rail_before_six_axes_and_a_column_before_a_scara_are_solved_by_iteration(
    tmp_path: Path,
) -> None:
    """No closed form covers a slide before six axes, or before the three axes of a SCARA."""
    six, scara = built_in("irb120"), built_in("cobras600")
    rail = Arm(
        (step((0, 0, 0)), *six.steps), (np.array(UP)[[2, 1, 0]], *six.axes),
        ("prismatic", *six.kinds), ((-1.5, 1.5), *six.limits), (1.0, *six.speeds), six.flange,
    )  # fmt: skip
    order = [2, 0, 1, 3]
    column = Arm(
        tuple(scara.steps[k] for k in (0, 2, 1, 3)),
        tuple(scara.axes[k] for k in order), tuple(scara.kinds[k] for k in order),
        tuple(scara.limits[k] for k in order), tuple(scara.speeds[k] for k in order), scara.flange,
    )  # fmt: skip
    for arm in (rail, column):
        robot = find_robot(write_urdf(tmp_path, urdf(arm)))
        assert robot.kind == "serial"
        joints = draw_joint_values(robot, 20)
        rotations, origins = compute_flange(robot, joints)
        solutions = compute_solutions(robot, rotations, origins)
        assert np.isfinite(solutions[:, 0, 0]).all()
        for row, branch in np.argwhere(np.isfinite(solutions[:, :, 0])):
            reached = tip(arm, solutions[row, branch] * metre_scale(robot))
            assert np.abs(1000 * reached[:3, 3] - origins[row]).max() < 1e-6
        shifted = joints + 120.0 * np.array([joint.sliding for joint in robot.joints])
        assert np.isfinite(damped.refine(robot, rotations, origins, shifted)).all()


@pytest.mark.parametrize("arm", [SEVEN, disguised(SEVEN, 4)], ids=["plain", "disguised"])
def test_an_arm_with_seven_joints_is_solved_by_iteration(arm: Arm, tmp_path: Path) -> None:
    robot = find_robot(write_urdf(tmp_path, urdf(arm)))
    assert robot.kind == "serial"
    joints = draw_joint_values(robot, 20)
    rotations, origins = compute_flange(robot, joints)
    for row, values in enumerate(joints):
        assert np.abs(origins[row] - 1000 * tip(arm, values)[:3, 3]).max() < 1e-9
    solutions = compute_solutions(robot, rotations, origins)
    assert np.isfinite(solutions[:, 0, 0]).all()
    for row, column in np.argwhere(np.isfinite(solutions[:, :, 0])):
        reached = tip(arm, solutions[row, column])
        assert np.abs(1000 * reached[:3, 3] - origins[row]).max() < 1e-6
        assert np.abs(reached[:3, :3] - rotations[row]).max() < 1e-9


def test_the_jacobian_holds_for_rotated_joint_frames(tmp_path: Path) -> None:
    robot = find_robot(write_urdf(tmp_path, urdf(disguised(built_in("cobotta"), 7))))
    joints = draw_joint_values(robot, 1)
    jacobian, _, origin = compute_jacobian(robot, joints)
    for k in range(6):
        other = joints.copy()
        other[0, k] += 1e-6
        assert jacobian[0, :3, k] == pytest.approx(
            (compute_flange(robot, other)[1] - origin)[0] / 1e-6, abs=2e-3
        )


def cobot_by_hand(q: np.ndarray) -> np.ndarray:
    """The flange of fixtures/robots/cobot.urdf, typed in again: base_from_flange (4, 4), m."""
    quarter = math.pi / 2
    base_from_link = np.eye(4)
    rows = [
        ((0, 0, 0.15), 0.0), ((0, 0, 0), quarter), ((-0.41, 0, 0), 0.0), ((-0.38, 0, 0.12), 0.0),
        ((0, -0.1, 0), quarter), ((0, 0.09, 0), -quarter),
    ]  # fmt: skip
    for (xyz, roll), value in zip(rows, q.tolist(), strict=True):
        base_from_link = (
            base_from_link @ step(xyz, rpy(roll, 0, 0)) @ step((0, 0, 0), turn((0, 0, 1), value))
        )
    return base_from_link


def test_a_cobot_with_three_parallel_axes_is_solved_in_closed_form() -> None:
    robot = find_robot(str(COBOT))
    assert robot.kind == "three-parallel"
    assert robot.convention == "The joints of the URDF, from link world to link tool0."
    joints = np.random.default_rng(0).uniform(-math.pi, math.pi, (60, 6))
    rotations, origins = compute_flange(robot, joints)
    for row, values in enumerate(joints):
        assert np.abs(origins[row] - 1000 * cobot_by_hand(values)[:3, 3]).max() < 1e-9
    solutions = compute_solutions(robot, rotations, origins)
    differences = np.abs(
        np.remainder(solutions - joints[:, None] + math.pi, math.tau) - math.pi
    ).max(axis=2)
    assert np.nanmin(differences, axis=1).max() < 1e-6
    for row, column in np.argwhere(np.isfinite(solutions[:, :, 0])):
        assert (
            np.abs(1000 * cobot_by_hand(solutions[row, column])[:3, 3] - origins[row]).max() < 1e-6
        )


def test_assumptions_about_a_urdf_are_noted() -> None:
    assert find_robot(str(COBOT)).notes == (
        "wrist_3_joint has no limits: -360 to 360 deg are assumed",
        "link finger is not part of the arm: it is left out",
        "3 rounded angles in the URDF: multiples of 90 deg are assumed",
    )
    assert find_robot(str(SIX)).notes == ()


@pytest.mark.parametrize(
    ("text", "angle"),
    [
        ("1.5708", math.pi / 2), ("-1.57", -math.pi / 2), ("3.1415", math.pi),
        ("3.14159265", math.pi), ("1.5707963267948966", math.pi / 2), ("6.2832", math.tau),
        ("1.571e0", math.pi / 2), ("157.08e-2", math.pi / 2), ("1.58", 1.58), ("1.6", 1.6),
        ("1.5718", 1.5718), ("1.57080", math.pi / 2), ("0.001", 0.001), ("-0", 0.0), ("1", 1.0),
        ("2", 2.0),
    ],
)  # fmt: skip
def test_a_rounded_multiple_of_90_deg_is_restored(text: str, angle: float, tmp_path: Path) -> None:
    """1.5708 and 1.57080 are both roundings of pi / 2; 1.5718 is 0.06 deg away and stays."""
    arm = urdf(SEVEN).replace('rpy="0 -0 0"', f'rpy="{text} 0 0"', 1)
    assert text in arm
    robot = find_robot(write_urdf(tmp_path, arm))
    difference = robot.joints[0].previous_from_joint.rotation - turn((1, 0, 0), angle)
    assert np.abs(difference).max() < rounding_bound(operations=10, functions=8)


def test_an_arm_with_rounded_angles_keeps_its_closed_form(tmp_path: Path) -> None:
    text = SIX.read_text().replace("1.57079632679", "1.5708")
    assert "1.5708" in text
    assert find_robot(write_urdf(tmp_path, text)).kind == "spherical-wrist"


def test_rpy_rotates_about_fixed_axes_and_the_default_axis_is_x(tmp_path: Path) -> None:
    text = (
        '<robot name="a"><link name="b"/><link name="c"/>'
        '<joint name="j" type="revolute"><parent link="b"/>'
        '<child link="c"/><origin rpy="0.1 0.2 0.3" xyz="1 2 3"/>'
        '<limit lower="-1" upper="1" velocity="2"/></joint>'
        "</robot>"
    )
    robot = find_robot(write_urdf(tmp_path, text))
    assert robot.joints[0].previous_from_joint.origin == (1000, 2000, 3000)
    assert robot.joints[0].axis == (1, 0, 0)
    # The y axis of the child under Rz(0.3) Ry(0.2) Rx(0.1), written out.
    sx, cx, sy, sz, cz = math.sin(0.1), math.cos(0.1), math.sin(0.2), math.sin(0.3), math.cos(0.3)
    expected = [cz * sy * sx - sz * cx, sz * sy * sx + cz * cx, math.cos(0.2) * sx]
    assert robot.joints[0].previous_from_joint.rotation[:, 1] == pytest.approx(expected, abs=1e-15)


def joint_xml(name: str, parent: str, child: str, kind: str = "fixed", more: str = "") -> str:
    limit = '<limit lower="-1" upper="1" velocity="1"/>' if kind == "revolute" else ""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{limit}{more}</joint>'


def tree(*joints: str, links: str = "abcdef") -> str:
    return (
        "<robot>"
        + "".join(f'<link name="{name}"/>' for name in links.split() or links)
        + "".join(joints)
        + "</robot>"
    )


FORK = (
    joint_xml("j1", "root", "a", "revolute"),
    joint_xml("j2", "a", "left", "revolute"),
    joint_xml("j3", "a", "right", "revolute"),
)


def test_the_tip_is_the_named_link_or_the_flange_or_the_farthest_link(tmp_path: Path) -> None:
    fork = write_urdf(tmp_path, tree(*FORK, links="root a left right"))
    with pytest.raises(CamgenError, match="it is not clear which link is the flange: left, right"):
        find_robot(fork)
    assert find_robot(f"{fork}#right").joints[1].name == "j3"
    assert find_robot(f"{fork}#a").convention == "The joints of the URDF, from link root to link a."
    longer = write_urdf(
        tmp_path,
        tree(*FORK, joint_xml("j4", "left", "hand", "revolute"), links="root a left right hand"),
    )
    robot = find_robot(longer)
    assert [joint.name for joint in robot.joints] == ["j1", "j2", "j4"]
    assert "the tip is hand, farthest from root, not right" in robot.notes
    flanged = write_urdf(
        tmp_path,
        tree(*FORK, joint_xml("f", "right", "my_tool0"), links="root a left right my_tool0"),
    )
    assert [joint.name for joint in find_robot(flanged).joints] == ["j1", "j3"]


def test_a_link_named_base_is_the_base_of_the_robot(tmp_path: Path) -> None:
    """REP 199: a link named base is the base frame of the controller, not the root."""
    lift = joint_xml("stand", "world", "base_link", more='<origin xyz="0 0 0.5"/>')
    seat = joint_xml(
        "seat", "base_link", "base", more='<origin xyz="0 0 0.1" rpy="0 0 3.14159265359"/>'
    )
    arm = joint_xml(
        "j1", "base_link", "tip", "revolute", more='<origin xyz="0.2 0 0.3"/><axis xyz="0 0 1"/>'
    )
    robot = find_robot(
        write_urdf(tmp_path, tree(lift, seat, arm, links="world base_link base tip"))
    )
    assert compute_flange(robot, np.zeros((1, 1)))[1][0] == pytest.approx([-200, 0, 200], abs=1e-9)
    assert robot.convention == "The joints of the URDF, from link base to link tip."
    robot = find_robot(write_urdf(tmp_path, tree(lift, arm, links="world base_link tip")))
    assert compute_flange(robot, np.zeros((1, 1)))[1][0] == pytest.approx([200, 0, 800], abs=1e-9)


def test_boxes_past_fixed_joints_belong_to_the_moving_link() -> None:
    robot = find_robot(str(COBOT))
    assert [len(link.boxes) for link in robot.links] == [2, 2, 2, 2, 1, 1, 3]
    gripper = robot.links[6].boxes[2]
    assert gripper.link_from_box.origin == pytest.approx((0, 0, 30))
    assert gripper.half == pytest.approx((30, 50, 30))


def test_home_is_not_singular() -> None:
    for name in (SIX, COBOT):
        robot = find_robot(str(name))
        assert are_within_limits(robot, robot.home)
        jacobian = compute_jacobian(robot, robot.home[None])[0][0]
        jacobian[:3] /= robot.lever
        assert np.linalg.svd(jacobian, compute_uv=False)[-1] > 0.05


def test_a_wrist_whose_axes_do_not_meet_is_solved_by_iteration(tmp_path: Path) -> None:
    """The wrist axes miss each other by 0.01 mm, so the wrist is not spherical."""
    arm = built_in("irb120")
    steps = list(arm.steps)
    steps[5] = steps[5] @ step((0, 0, 1e-5))
    robot = find_robot(write_urdf(tmp_path, urdf(arm._replace(steps=tuple(steps)))))
    assert recognise_arm(robot.joints, robot.flange) is None
    joints = draw_joint_values(robot, 10)
    rotations, origins = compute_flange(robot, joints)
    solutions = compute_solutions(robot, rotations, origins)
    differences = np.abs(
        np.remainder(solutions - joints[:, None] + math.pi, math.tau) - math.pi
    ).max(axis=2)
    assert np.nanmin(differences, axis=1).max() < 1e-6


def build_bracket(name: str, home: list[float], **more: object) -> camgen.Result:
    """Build the bracket for a robot. more: further keys of the cell."""
    cell = {
        "robot": name,
        "base_from_work": [300, -60, -50, 0, 0, 0],
        "flange_from_tool": [0, 0, 100, 0, 0, 0],
    }
    return build(
        FIXTURES / "parts" / "bracket.dxf",
        post="rapid",
        job={"cell": {**cell, "home": home, **more}},
    )


@pytest.mark.parametrize(
    ("name", "home"), [(SIX, [0, -100, 0, 0, 30, 0]), (COBOT, [180, -90, 100, -100, -90, 0])]
)
def test_a_program_is_built_for_an_arm_of_a_urdf(name: Path, home: list[float]) -> None:
    result = build_bracket(str(name), home)
    assert result.reach is not None
    assert result.reach.robot == name.stem
    robot = find_robot(str(name))
    assert np.all(are_within_limits(robot, result.reach.joints))
    notes = [str(note) for note in result.notes if name.name in note.what]
    assert notes[1:] == [f"assumed: {name.name}: {note}" for note in robot.notes]
    assert notes[0] == (
        f"warning: {name.name}: home and posture are in the joint values of the URDF "
        "(the zeros and signs of the controller may differ: "
        "compare one pose with the teach pendant)"
    )


@pytest.mark.parametrize(
    ("name", "is_abb"),
    [("abb_irb120_3_58", True), ("irb 120", True), ("my arm", False), ("abb_irb2400", False)],
)
def test_an_arm_with_the_name_and_the_axes_of_an_abb_robot_gets_its_confdata(
    tmp_path: Path, name: str, is_abb: bool
) -> None:
    """The postures are those of the built-in arm. With a reversed axis it is not an ABB robot."""
    arm = built_in("irb120")
    rows = np.radians([[-10, 20, 10, 100, -30, 200], [0, 0, 0, 0, 30, 0]])
    straight = np.zeros(2, dtype=np.bool_)
    robot = find_robot(write_urdf(tmp_path, urdf(arm, name)))
    expected = compute_postures(find_robot("IRB 120"), rows, straight)
    assert compute_postures(robot, rows, straight) == (expected if is_abb else [None, None])
    assert any("ABB" in note for note in robot.notes) == is_abb
    reversed_arm = arm._replace(axes=(*arm.axes[:3], -arm.axes[3], *arm.axes[4:]))
    other = find_robot(write_urdf(tmp_path, urdf(reversed_arm, name)))
    assert compute_postures(other, rows, straight) == [None, None]


def test_a_part_out_of_reach_is_refused() -> None:
    with pytest.raises(NoSafeProgram, match=r"six cannot run path c\d+ at .* mm: out of reach by"):
        build_bracket(str(SIX), [0, -100, 0, 0, 30, 0], base_from_work=[900, 0, 0, 0, 0, 0])


def test_a_job_file_names_an_arm_relative_to_its_own_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = tmp_path / "cell"
    cell.mkdir()
    (cell / "arm.urdf").write_text(COBOT.read_text())
    (cell / "part.dxf").write_bytes((FIXTURES / "parts" / "bracket.dxf").read_bytes())
    (cell / "part.toml").write_text(
        '[cell]\nrobot = "arm.urdf#tool0"\nbase_from_work = [300, -60, -50, 0, 0, 0]\n'
        "flange_from_tool = [0, 0, 100, 0, 0, 0]\nhome = [180, -90, 100, -100, -90, 0]\n"
    )
    monkeypatch.chdir(tmp_path)
    assert main(["build", "cell/part.dxf", "--post", "rapid"]) == 0
    messages = capsys.readouterr().err
    assert "arm.urdf: wrist_3_joint has no limits: -360 to 360 deg are assumed" in messages
    assert (tmp_path / "part.mod").is_file()


def build_job_line(folder: Path, text: str, mesh: bytes) -> str:
    """Build for an arm with this URDF and mesh; return the line with the job hash."""
    meshes = folder / "six_description" / "meshes"
    meshes.mkdir(parents=True, exist_ok=True)
    (meshes / "turn.stl").write_bytes(mesh)
    (meshes / "upper.stl").write_bytes(
        (SIX.parent / "six_description" / "meshes" / "upper.stl").read_bytes()
    )
    (folder / "six.urdf").write_text(text)
    result = build_bracket(str(folder / "six.urdf"), [0, -100, 0, 0, 30, 0])
    return next(line for line in result.text.split("\n") if "job" in line)


def test_the_job_hash_covers_the_urdf_and_its_meshes_but_not_their_folder(tmp_path: Path) -> None:
    text = SIX.read_text()
    mesh = (SIX.parent / "six_description" / "meshes" / "turn.stl").read_bytes()
    first = build_job_line(tmp_path / "a", text, mesh)
    assert build_job_line(tmp_path / "b", text, mesh) == first
    assert (
        build_job_line(tmp_path / "c", text.replace('velocity="3', 'velocity="4', 1), mesh) != first
    )
    assert build_job_line(tmp_path / "d", text, b"other".ljust(80) + mesh[80:]) != first
    assert [path.name for path in list_urdf_files(str(SIX), Files())] == [
        "six.urdf",
        "turn.stl",
        "upper.stl",
    ]


def test_camgen_robots_prints_its_interpretation_of_a_urdf(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["robots", str(COBOT)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:3] == [
        "cobot",
        "The joints of the URDF, from link world to link tool0.",
        "joints in closed form: three parallel axes, 8 branches",
    ]
    assert " ".join(lines[6].split()) == "elbow forearm -180 deg 180 deg 179.909/s -30 2"
    assert "note: wrist_3_joint has no limits: -360 to 360 deg are assumed" in lines
    assert main(["robots", "IRB 120"]) == 0
    assert "spherical wrist, 8 branches" in capsys.readouterr().out


def test_the_frames_of_links_are_those_of_the_urdf(tmp_path: Path) -> None:
    """The boxes of a link are given in its frame."""
    arm = disguised(built_in("irb120"), 2)
    robot = find_robot(write_urdf(tmp_path, urdf(arm)))
    joints = draw_joint_values(robot, 5)
    rotations, origins = compute_link_frames(robot, joints)
    for row, values in enumerate(joints):
        for k in range(1, 7):
            shorter = Arm(*(column[:k] for column in arm[:5]), np.eye(4))
            expected = tip(shorter, values[:k])
            assert np.abs(origins[row, k] - 1000 * expected[:3, 3]).max() < 1e-9
            assert np.abs(rotations[row, k] - expected[:3, :3]).max() < 1e-12


def test_an_arm_in_millimetres_is_refused(tmp_path: Path) -> None:
    """The lengths of the seven axes are 0.3 + 0.35 + 0.35 + 0.1 + 0.12 = 1.22 m."""
    steps = tuple(step((0, 0, z)) for z in (300, 0, 350, 0, 350, 0, 100))
    large = SEVEN._replace(steps=steps, flange=step((0, 0, 120)))
    with pytest.raises(CamgenError) as error:
        find_robot(write_urdf(tmp_path, urdf(large, "large")))
    assert str(error.value).endswith(
        "arm.urdf: is an arm of 1220 m; lengths in mm, where URDF has metres? (origin); "
        "divide its lengths by 1000"
    )
