"""The conformance kit: the example post conforms, installed and by path, and posts with known faults do not."""

import json
from itertools import count
from pathlib import Path

import pytest
from msgspec.structs import replace

from camgen.model.errors import JobError, Refused
from camgen.model.pose import Pose
from camgen.model.program import Comment, Joints, MoveJ, MoveL, Output, Wait
from camgen.post import OutputFile
from camgen.post.kit import FEATURES, WHOLE, Case, cases, check_case, conformance
from camgen.post.plugins import find_post, find_readback
from tests.support import installed
from tests.support.installed import install

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "example_post"
LACKS = {"force", "spindle", "signals", "split"}
WEND = find_post(str(EXAMPLE / "wend.py"))
READ = find_readback(str(EXAMPLE / "wend.py"))


@pytest.mark.parametrize("case", cases(), ids=str)
def test_the_example_conforms(case):
    check_case(WEND, READ, case, lacks=LACKS)


def test_options_go_to_post_and_readback():
    options = {"signals": {"process": 3, "glue": 4}, "decimals": 4}
    assert conformance(WEND, READ, options, LACKS - {"signals"}) == []


def test_the_example_is_as_short_as_promised():
    assert len((EXAMPLE / "wend.py").read_text().splitlines()) < 150


def test_the_tutorial_shows_the_example_as_it_is():
    """Every Python block of the tutorial stands in the example, line by line."""
    text = (ROOT / "docs" / "writing-a-post.md").read_text()
    source = (EXAMPLE / "wend.py").read_text() + (EXAMPLE / "wend_readback.py").read_text()
    blocks = [part.partition("```")[0] for part in text.split('```python title="from the example"\n')[1:]]
    assert len(blocks) >= 4
    for block in blocks:
        assert block.strip("\n") in source, block


# What a post may not do: each of these is a post with one fault, and what the kit says about it.


class Drops(WEND):
    def wait(self, _item):
        return ()


class DropsArcs(WEND):
    def movec(self, _motion):
        return ()


class Swaps(WEND):
    def movel(self, motion):
        x, y, z = motion.target.origin
        return super().movel(replace(motion, target=Pose(motion.target.rotation, (y, x, z))))


class Radians(WEND):
    def movej(self, motion):
        if isinstance(motion.target, Pose):
            return super().movej(motion)
        return (f"JOINT {' '.join(f'{v:.4f}' for v in motion.target.values)} AT {motion.speed:.2f}",)


class Metres(WEND):
    def movel(self, motion):
        x, y, z = motion.target.origin
        return super().movel(replace(motion, target=Pose(motion.target.rotation, (x / 1000, y / 1000, z / 1000))))


class Milliseconds(WEND):
    def wait(self, item):
        return super().wait(Wait(item.seconds * 1000))


class MetresPerMinute(WEND):
    def movel(self, motion):
        return super().movel(replace(motion, speed=motion.speed * 0.06))


class ViaTwice(WEND):
    def movec(self, motion):
        return super().movec(replace(motion, target=motion.via))


class EndTwice(WEND):
    def movec(self, motion):
        return super().movec(replace(motion, via=motion.target))


class OtherWayRound(WEND):
    def movec(self, motion):
        x, y, z = motion.via.origin
        return super().movec(replace(motion, via=Pose(motion.via.rotation, (x, -y, z))))


class Clamps(WEND):
    def movel(self, motion):
        return super().movel(replace(motion, speed=min(motion.speed, 250.0)))


class Stops(WEND):
    def movel(self, motion):
        return super().movel(replace(motion, blend=0.0))


class TransposesRotations(WEND):
    def _place(self, pose):
        return super()._place(Pose(pose.rotation.T, pose.origin))


class FewDigits(WEND):
    def movel(self, motion):
        x, y, z = (round(v, 2) for v in motion.target.origin)
        return super().movel(replace(motion, target=Pose(motion.target.rotation, (x, y, z))))


class ForgetsTheFrame(WEND):
    def begin(self, program):
        return super().begin(replace(program, base_from_work=self.cell().base_from_work))


class InvertsOutputs(WEND):
    def output(self, item):
        return super().output(Output(item.signal, 1 - item.value))


class RawComments(WEND):
    def note(self, text):
        return self.comment(text)


class MinusZero(WEND):
    def movel(self, motion):
        return [line.replace(" 0.000 ", " -0.000 ") for line in super().movel(motion)]


class Exponents(WEND):
    def wait(self, item):
        return (f"PAUSE {item.seconds}" if item.seconds > 0.01 else f"PAUSE {item.seconds:.1e}",)


class NotANumber(WEND):
    def end(self, _program):
        return ("* X nan", "END")


_ticks = count()


class Restless(WEND):
    def end(self, _program):
        return (f"* {next(_ticks)}", "END")


class NoNewline(WEND):
    def assemble(self, program, parts):
        return tuple(OutputFile(f.name, f.text.rstrip("\n")) for f in super().assemble(program, parts))


class CarriageReturns(WEND):
    def assemble(self, program, parts):
        return tuple(OutputFile(f.name, f.text.replace("\n", "\r\n")) for f in super().assemble(program, parts))


class Elsewhere(WEND):
    def assemble(self, program, parts):
        return tuple(OutputFile("../" + f.name, f.text) for f in super().assemble(program, parts))


class TwoWithOneName(WEND):
    def assemble(self, program, parts):
        return super().assemble(program, parts) * 2


class Nothing(WEND):
    def assemble(self, _program, _parts):
        return ()


class Shy(WEND):
    def refuses(self, item, start):
        return "not today" if isinstance(item, MoveL) else super().refuses(item, start)


class Mute(WEND):
    def prepare(self, _program, _chord):
        raise Refused(self.name, 0, " ")


class Lost(WEND):
    def prepare(self, _program, _chord):
        raise Refused(self.name, 10_000, "something is wrong")


class Sweeping(WEND):
    def prepare(self, _program, _chord):
        raise Refused(self.name, -1, "something is wrong")


class Broken(WEND):
    def end(self, _program):
        raise JobError("[post]", "no such thing")


SAYS = {
    Drops: "planned is wait",
    DropsArcs: "planned is MoveC",
    Swaps: "target reads",
    Radians: "joint values reads",
    Metres: "target reads",
    Milliseconds: "wait reads",
    MetresPerMinute: "speed reads",
    ViaTwice: "target reads",
    EndTwice: "middle of the arc reads",
    OtherWayRound: "middle of the arc reads",
    Clamps: "speed reads 250, planned is 1000",
    Stops: "blend reads 0",
    TransposesRotations: "orientation reads",
    FewDigits: "target reads",
    ForgetsTheFrame: "the work frame reads",
    InvertsOutputs: "output reads",
    RawComments: "not a WEND statement: G0 Z-50",
    MinusZero: "has a minus zero in line",
    Exponents: "has an exponent in line",
    NotANumber: "has a number that is none in line",
    Restless: "the same program gives two texts",
    NoNewline: "does not end with a newline",
    CarriageReturns: "has a control character",
    Elsewhere: "is no file name",
    TwoWithOneName: "two with one name",
    Nothing: "no file",
    Shy: "refused a MoveL that uses nothing the controller is said to lack",
    Mute: "refused without a reason",
    Lost: "refused instruction 10000, which is not there",
    Broken: "JobError: [post]: no such thing",
}


@pytest.mark.parametrize("post", SAYS, ids=lambda post: post.__name__)
def test_a_fault_is_found(post):
    found = conformance(post, READ, lacks=LACKS)
    assert any(SAYS[post] in line for line in found), found


def test_a_post_may_not_refuse_everything_at_once():
    assert any("refused as a whole" in line for line in conformance(Sweeping, READ, lacks=LACKS - {"split"}))


def test_what_is_not_declared_may_not_be_refused():
    found = conformance(WEND, READ)
    assert {line.partition(":")[0] for line in found} == {
        "force", "force along an arc", "force twice", "spindle", "signals", "several files",
    }  # fmt: skip


def test_features_are_known_by_name():
    with pytest.raises(ValueError, match="no such feature"):
        conformance(WEND, READ, lacks={"wings"})


def test_a_readback_that_reports_nothing_is_found():
    def blind(files, options):
        return replace(READ(files, options), body=(), lines=())

    assert len(conformance(WEND, blind, lacks=LACKS)) >= len(cases()) - 6


def test_check_case_raises_all_findings_of_a_case():
    case = next(case for case in cases() if case.name == "waits")
    with pytest.raises(AssertionError, match="waits: "):
        check_case(Milliseconds, READ, case, lacks=LACKS)


def test_the_cases_use_every_instruction_and_every_feature():
    items = [item for case in cases() for item in case.body]
    assert {type(item).__name__ for item in items} == {"MoveJ", "MoveL", "MoveC", "Output", "Wait", "Force", "Comment"}
    assert [name for name, uses in FEATURES.items() if not any(map(uses, items))] == []
    assert len({case.name for case in cases()}) == len(cases())
    assert set(WHOLE).isdisjoint(FEATURES)


def test_a_case_starts_at_the_home_of_the_cell():
    cell = WEND.cell()
    program = Case("x", (Comment("c"), MoveJ(Joints((1.0,) * 9), 5.0))).program(cell)
    assert isinstance(program.body[0], MoveJ)
    assert program.body[0].target is cell.home
    assert program.body[2].target == Joints((1.0,) * 6)


# The example as a package of its own.


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return install(EXAMPLE, tmp_path_factory.mktemp("example"))


def run(site, *arguments):
    done = installed.run(site, *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_installed_example_is_found_and_conforms(site):
    code = (
        "import json, sys, wend\n"
        "from camgen.post.plugins import find_post, find_readback, installed\n"
        "from camgen.post.kit import conformance\n"
        "found = conformance(find_post('wend'), find_readback('wend'), lacks=set(sys.argv[1:]))\n"
        "entry = next(e for e in installed() if e.name == 'wend')\n"
        "print(json.dumps([wend.__file__, entry.origin, entry.suffix, entry.broken, found]))\n"
    )
    file, *rest = json.loads(run(site, "-c", code, *LACKS))
    assert Path(file).parent == site
    assert rest == ["camgen-wend 1.0", ".wnd", "", []]


def test_the_command_line_lists_the_installed_example(site):
    listing = run(site, "-m", "camgen", "posts")
    (line,) = (line for line in listing.splitlines() if line.strip().startswith("wend"))
    assert "camgen-wend" in line
