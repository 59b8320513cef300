"""The conformance kit passes the example post of the tutorial and finds the faults of others."""

import math
import re
from itertools import chain, count
from pathlib import Path

import pytest
from msgspec.structs import replace

from camgen.model.errors import JobError, Refused
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Comment, Joints, MoveJ, MoveL, Output, Wait
from camgen.post import OutputFile
from camgen.post.altered import alter_numbers, is_excused
from camgen.post.kit import FEATURES, WHOLE, Case, cases, check_case, conformance
from camgen.post.plugins import find_post
from tests.support.modules import load_module

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "example_post"
LACKS = {"force", "spindle", "signals", "stops", "tool changes", "split"}
#: As in the example: comments, the sign of 180 deg, and the last digit of an auxiliary point.
MEANINGLESS = (
    r";.*",
    r"[ABC]( |-)180\.0+",
    r"CIRC \{X -?\d+\.\d+(\d),",
    r"CIRC \{X [-.\d]+, Y -?\d+\.\d+(\d),",
)
FAST = {"max_speed": 3000.0}
KRL = find_post(str(EXAMPLE / "krl.py"))
LANGUAGE = load_module(EXAMPLE / "krl_language.py").KRL


@pytest.mark.parametrize("case", cases(), ids=str)
def test_the_example_conforms(case):
    check_case(KRL, LANGUAGE, case, FAST, LACKS, MEANINGLESS)


def test_options_go_to_post_and_language():
    options = {
        **FAST,
        "signals": {"process": 3, "glue": 4, "spindle": 9},
        "spindle_rpm": 12000.0,
        "decimals": 4,
    }
    lacks = {"force", "stops", "tool changes", "split"}
    assert conformance(KRL, LANGUAGE, options, lacks, MEANINGLESS) == []


# Each of these posts has one fault. `FINDINGS` has the finding of the kit about it.


class DropsWaits(KRL):
    def wait(self, _item):
        return ()


class DropsArcs(KRL):
    def movec(self, _motion):
        return ()


class SwapsXAndY(KRL):
    def movel(self, motion):
        x, y, z = motion.target.origin
        return super().movel(replace(motion, target=Pose(motion.target.rotation, (y, x, z))))


class PrintsRadians(KRL):
    def movej(self, motion):
        if isinstance(motion.target, Pose):
            return super().movej(motion)
        axes = ", ".join(f"A{k} {v:.4f}" for k, v in enumerate(motion.target.values, 1))
        return (f"PTP {{{axes}}}",)


class PrintsMetres(KRL):
    def movel(self, motion):
        x, y, z = motion.target.origin
        return super().movel(
            replace(motion, target=Pose(motion.target.rotation, (x / 1000, y / 1000, z / 1000)))
        )


class PrintsMilliseconds(KRL):
    def wait(self, item):
        return super().wait(Wait(item.seconds * 1000))


class PrintsMetresPerMinute(KRL):
    def movel(self, motion):
        return super().movel(replace(motion, speed=motion.speed * 0.06))


class EndsAtTheViaPoint(KRL):
    def movec(self, motion):
        return super().movec(replace(motion, target=motion.via))


class PassesThroughTheEnd(KRL):
    def movec(self, motion):
        return super().movec(replace(motion, via=motion.target))


class MirrorsArcs(KRL):
    def movec(self, motion):
        x, y, z = motion.via.origin
        return super().movec(replace(motion, via=Pose(motion.via.rotation, (x, -y, z))))


class ClampsSpeeds(KRL):
    def movel(self, motion):
        return super().movel(replace(motion, speed=min(motion.speed, 250.0)))


class StopsAtEachTarget(KRL):
    def movel(self, motion):
        return super().movel(replace(motion, blend=0.0))


class TransposesRotations(KRL):
    def _place(self, pose):
        return super()._place(
            Pose(pose.rotation.T, pose.origin) if isinstance(pose, Pose) else pose
        )


class PrintsTwoDigits(KRL):
    def movel(self, motion):
        x, y, z = (round(v, 2) for v in motion.target.origin)
        return super().movel(replace(motion, target=Pose(motion.target.rotation, (x, y, z))))


class ForgetsTheFrame(KRL):
    def begin(self, program):
        return super().begin(replace(program, base_from_work=self.cell().base_from_work))


class InvertsOutputs(KRL):
    def output(self, item):
        return super().output(Output(item.signal, 1 - item.value))


class PrintsRawComments(KRL):
    def note(self, text):
        return self.comment(text)


class PrintsMinusZero(KRL):
    def movel(self, motion):
        return [line.replace(" 0.000,", " -0.000,") for line in super().movel(motion)]


class PrintsExponents(KRL):
    def wait(self, item):
        return (
            f"WAIT SEC {item.seconds}" if item.seconds > 0.01 else f"WAIT SEC {item.seconds:.1e}",
        )


class PrintsNaN(KRL):
    def end(self, _program):
        return ("; X nan", "END")


_ticks = count()


class PrintsAnotherTextEachTime(KRL):
    def end(self, _program):
        return (f"; {next(_ticks)}", "END")


class EndsWithoutNewline(KRL):
    def assemble(self, program, parts):
        return tuple(
            OutputFile(f.name, f.text.rstrip("\n")) for f in super().assemble(program, parts)
        )


class PrintsCarriageReturns(KRL):
    def assemble(self, program, parts):
        return tuple(
            OutputFile(f.name, f.text.replace("\n", "\r\n"))
            for f in super().assemble(program, parts)
        )


class WritesOutsideOfTheFolder(KRL):
    def assemble(self, program, parts):
        return tuple(OutputFile("../" + f.name, f.text) for f in super().assemble(program, parts))


class WritesTwoFilesOfOneName(KRL):
    def assemble(self, program, parts):
        return super().assemble(program, parts) * 2


class WritesNoFile(KRL):
    def assemble(self, _program, _parts):
        return ()


class RefusesStraightMotions(KRL):
    def why_not(self, item, before, after):
        return "not today" if isinstance(item, MoveL) else super().why_not(item, before, after)


class RefusesWithoutReason(KRL):
    def prepare(self, _program, _chord):
        raise Refused(self.name, 0, " ")


class RefusesAnUnknownInstruction(KRL):
    def prepare(self, _program, _chord):
        raise Refused(self.name, 10_000, "something is wrong")


class RefusesAsAWhole(KRL):
    def prepare(self, _program, _chord):
        raise Refused(self.name, -1, "something is wrong")


class RaisesJobError(KRL):
    def end(self, _program):
        raise JobError("[post]", "no such thing")


class VerifiesAnUnknownField(KRL):
    verified_fields = frozenset({"orientation", "spede"})


class HasAnInfiniteTolerance(KRL):
    def tolerance(self):
        return replace(super().tolerance(), speed=math.inf)


class HasACoarseTolerance(KRL):
    def tolerance(self):
        return replace(super().tolerance(), mm=0.05)


class HalvesSpeeds(KRL):
    def prepare(self, program, chord):
        program = super().prepare(program, chord)
        slow = [replace(x, speed=x.speed / 2) if isinstance(x, MoveL) else x for x in program.body]
        return program.with_body(tuple(slow))


class PreparesABody(KRL):
    def prepare(self, program, chord):
        return super().prepare(program, chord).body


class DropsStops(KRL):
    def stop(self, _item):
        return ()


class DropsToolChanges(KRL):
    changes_tools = True

    def change_tool(self, _item):
        return ()


class DropsReorientations(KRL):
    def movel(self, motion):
        straight = replace(motion, target=Pose(TOOL_DOWN, motion.target.origin))
        return super().movel(straight if motion.turn else motion)


FINDINGS = {
    VerifiesAnUnknownField: "verified_fields has the unknown word 'spede'",
    HasAnInfiniteTolerance: "tolerance() speed = inf is not finite",
    HasACoarseTolerance: "coordinates are printed to 0.05 mm, but tolerance.chord = 0.01",
    HalvesSpeeds: "instruction 2: the preparation changes the speed",
    PreparesABody: "prepare() is ",
    DropsStops: "stops: kit.src: instruction 6: instruction reads MoveL",
    DropsToolChanges: "tool changes: kit.src: instruction 0: instruction reads MoveJ",
    DropsReorientations: "turns on the spot: kit.src: instruction 3: orientation reads",
    DropsWaits: "planned is wait",
    DropsArcs: "planned is MoveC",
    SwapsXAndY: "target reads",
    PrintsRadians: "joint values reads",
    PrintsMetres: "target reads",
    PrintsMilliseconds: "wait reads",
    PrintsMetresPerMinute: "speed reads",
    EndsAtTheViaPoint: "target reads",
    PassesThroughTheEnd: "middle of the arc reads",
    MirrorsArcs: "middle of the arc reads",
    ClampsSpeeds: "speed reads 250, planned is 1000",
    StopsAtEachTarget: "blend reads 0",
    TransposesRotations: "orientation reads",
    PrintsTwoDigits: "target reads",
    ForgetsTheFrame: "the work frame reads",
    InvertsOutputs: "output reads",
    PrintsRawComments: "not a statement that is known: G0 Z-50",
    PrintsMinusZero: "has a minus zero in line",
    PrintsExponents: "has an exponent in line",
    PrintsNaN: "has NaN or infinity in line",
    PrintsAnotherTextEachTime: "the same program gives two texts",
    EndsWithoutNewline: "does not end with a newline",
    PrintsCarriageReturns: "has a control character",
    WritesOutsideOfTheFolder: "is not a file name",
    WritesTwoFilesOfOneName: "two with one name",
    WritesNoFile: "no file",
    RefusesStraightMotions: "refused a MoveL that uses nothing the controller is said to lack",
    RefusesWithoutReason: "refused without a reason",
    RefusesAnUnknownInstruction: "refused instruction 10000, which is not there",
    RaisesJobError: "JobError: [post]: no such thing",
}


def has_finding(post, read, lacks, message, cases):
    """Whether the kit reports the finding in a case. The cases after it are not run."""
    for case in cases:
        try:
            check_case(post, read, case, FAST, lacks, MEANINGLESS)
        except AssertionError as error:
            if message in str(error):
                return True
    return False


@pytest.mark.parametrize("post", FINDINGS, ids=lambda post: post.__name__)
def test_a_fault_of_a_post_is_found(post):
    lacks = LACKS - {"stops", "tool changes"}
    # Changed numbers test the read-back, which is right here, and take most of the time.
    plain = [replace(case, altered="") for case in cases()]
    assert has_finding(post, LANGUAGE, lacks, FINDINGS[post], plain)


# Read-backs that ignore a number of a right text


def spoil(pattern, replacement):
    """A read-back that reads the text after `pattern` is replaced."""

    def run(files, options):
        changed = {name: re.sub(pattern, replacement, text) for name, text in files.items()}
        return LANGUAGE.run(changed, options)

    return replace(LANGUAGE, run=run)


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        (r"\$VEL_AXIS\[(\d)\]=.*", r"$VEL_AXIS[\1]=10", "$VEL_AXIS[1]=60"),
        (r"\$APO\.CDIS=.*", "$APO.CDIS=5.000", "blend reads"),
        (r"WAIT SEC .*", "WAIT SEC 0.250", "WAIT SEC 5.250"),
    ],
)
def test_a_number_that_the_language_ignores_is_found(pattern, replacement, message):
    assert has_finding(KRL, spoil(pattern, replacement), LACKS, message, cases())


def test_each_number_is_changed_in_several_ways_and_excused_by_its_place():
    text = "A1 -2.50\nB 0.00\nA1 3.75\n"
    changes = list(alter_numbers(text))
    assert [change.text.split("\n")[0] for change in changes if change.line == 1] == [
        *("A6 -2.50", "A-1 -2.50", "A1 -7.50", "A1 -2.55", "A1 2.50"),
    ]
    assert [change.text.split("\n")[1] for change in changes if change.line == 2] == [
        *("B 5.00", "B 0.05"),
    ]
    assert {change.line for change in alter_numbers(text, 2)} == {2, 3}
    last = [change for change in changes if is_excused(change, text, [r"\.\d(\d)"])]
    assert [change.what.split(" as ")[1] for change in last] == [
        *("'A1 -2.55'", "'B 0.05'", "'A1 3.70'"),
    ]
    assert not any(is_excused(change, text, [r"^C .*"]) for change in changes)


def test_a_change_that_no_pattern_names_is_a_finding():
    findings = conformance(KRL, LANGUAGE, FAST, LACKS)
    assert findings
    assert all("a changed number is not seen: line" in line for line in findings)


def test_a_post_may_not_refuse_everything_at_once():
    findings = conformance(RefusesAsAWhole, LANGUAGE, FAST, LACKS - {"split"}, MEANINGLESS)
    assert any("refused as a whole" in line for line in findings)


def test_a_feature_that_is_not_declared_as_missing_may_not_be_refused():
    findings = conformance(KRL, LANGUAGE, meaningless=MEANINGLESS)
    assert {line.partition(":")[0] for line in findings} == {
        "speeds",
        "force",
        "force along an arc",
        "force twice",
        "spindle",
        "signals",
        "several files",
        "stops",
        "optional stops",
        "tool changes",
    }


def test_an_unknown_feature_is_refused():
    with pytest.raises(ValueError, match="no such feature"):
        conformance(KRL, LANGUAGE, lacks={"wings"})


def test_a_language_that_reports_nothing_is_found():
    def run(files, options):
        return replace(LANGUAGE.run(files, options), body=(), lines=())

    blind = replace(LANGUAGE, run=run)
    assert len(conformance(KRL, blind, FAST, LACKS)) >= len(cases()) - 9


def test_check_case_raises_all_findings_of_a_case():
    case = next(case for case in cases() if case.name == "waits")
    with pytest.raises(AssertionError, match="waits: "):
        check_case(PrintsMilliseconds, LANGUAGE, case, lacks=LACKS)


def test_the_cases_use_every_instruction_and_every_feature():
    items = list(chain.from_iterable(case.body for case in cases()))
    assert {type(item).__name__ for item in items} == {
        "MoveJ",
        "MoveL",
        "MoveC",
        "Output",
        "Wait",
        "Force",
        "ToolChange",
        "Stop",
        "Comment",
    }
    assert [name for name, uses in FEATURES.items() if not any(map(uses, items))] == []
    assert len({case.name for case in cases()}) == len(cases())
    assert set(WHOLE).isdisjoint(FEATURES)


def test_a_case_starts_at_the_home_of_the_cell():
    cell = KRL.cell()
    program = Case("x", (Comment("c"), MoveJ(Joints((1.0,) * 9), 5.0))).program(cell)
    assert isinstance(program.body[0], MoveJ)
    assert program.body[0].target is cell.home
    assert program.body[2].target == Joints((1.0,) * 6)
