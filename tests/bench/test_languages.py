"""The lists of public programs and of mutants: their rule, their comparison and their faults."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from bench.languages import choose, examine, public, verdicts
from bench.languages.choose import RULES, Entry
from bench.languages.mirror import Mirror, MissingError
from bench.reliability import mutants
from bench.reliability.mutants import Family, find_verdicts, plan_batches
from bench.reliability.programs import PostedProgram, make
from camgen.lang.programs import LEVELS
from camgen.model.instructions import Wait
from camgen.model.pose import IDENTITY, Pose
from camgen.model.program import MoveL

RAPID = """MODULE Made
  CONST robtarget pA:=[[400,0,300],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    MoveJ pA,v200,fine,tool0;
    MoveL Offs(pA,50,0,0),v100,fine,tool0;
  ENDPROC
  PROC beside()
    WaitTime 1.5;
  ENDPROC
ENDMODULE
"""
GCODE = "G21 G90\n" + "".join(f"G1 X{k} Y0 Z-1 F300\n" for k in range(12)) + "M2\n"


def commit(folder: Path, files: dict[str, str]) -> str:
    """Makes a git repository with one commit of some files. Returns the commit."""
    folder.mkdir(parents=True)
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    user = ("-c", "user.name=made", "-c", "user.email=made@example.com")
    for words in (["init", "-q"], ["add", "-A"], [*user, "commit", "-q", "-m", "made"]):
        subprocess.run(["git", "-C", str(folder), *words], check=True)
    head = ["git", "-C", str(folder), "rev-parse", "HEAD"]
    return subprocess.run(head, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def mirror(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one repository, which is the only one of the rule, with empty lists."""
    files = {
        "sub/made.mod": RAPID,
        "note.mod": "MODULE Note\nENDMODULE\n" + 20 * "! nothing moves\n",
        "made.nc": GCODE,
        "short.nc": GCODE.replace("Z-1", "") + 100 * " ",
        "few.nc": "G21\n" + 9 * "G1 X10 Y10 Z10 F1000\n" + 100 * "(G1 X1)\n",
        "made.txt": RAPID,
    }
    commit(tmp_path / "mirror" / "owner+name", files)
    rows = ["language\tgroup\trepository"]
    rows += [f"{language}\tknown\towner/name" for language in ("gcode", "rapid")]
    rows.append("rapid\tnew\towner/gone")
    (tmp_path / "repositories.tsv").write_text("\n".join(rows) + "\n")
    monkeypatch.setattr(choose, "REPOSITORIES", tmp_path / "repositories.tsv")
    monkeypatch.setattr(choose, "LIST", tmp_path / "public.tsv")
    monkeypatch.setattr(public, "FINDINGS", tmp_path / "findings.tsv")
    monkeypatch.setattr(verdicts, "VERDICTS", tmp_path / "verdicts.tsv")
    (tmp_path / "public.tsv").write_text("\t".join(Entry._fields) + "\n")
    return tmp_path / "mirror"


def run_bench(module: object, words: list[str], monkeypatch: pytest.MonkeyPatch) -> object:
    """Runs the main function of a bench with words of a command line."""
    monkeypatch.setattr(sys, "argv", ["bench", *words])
    return module.main()  # type: ignore[attr-defined]


def test_the_committed_list_keeps_its_rule_and_has_findings() -> None:
    entries = choose.read_list()
    groups = choose.read_repositories()
    assert len({(entry.repository, entry.path) for entry in entries}) == len(entries) == 190
    for entry in entries:
        assert entry.repository in groups[entry.language, entry.group]
        assert re.fullmatch(r"[0-9a-f]{40}", entry.commit)
        assert entry.path.lower().endswith(RULES[entry.language].suffixes)
    per_repository = Counter((entry.language, entry.repository) for entry in entries)
    assert all(
        count <= RULES[language].per_repository for (language, _), count in per_repository.items()
    )
    rows = public.read_findings()
    assert list(rows) == [(entry.repository, entry.path) for entry in entries]
    assert not any("traceback" in row.counts for row in rows.values())


def test_each_committed_verdict_has_a_finding_of_the_list_and_a_reason() -> None:
    programs = {(entry.repository, entry.path) for entry in choose.read_list()}
    rows = verdicts.read_verdicts().values()
    lines = verdicts.VERDICTS.read_text(encoding="utf-8").splitlines()
    assert len(rows) == len(lines) - 1, "two verdicts on one finding"
    for row in rows:
        assert (row.repository, row.path) in programs
        assert row.level in LEVELS
        assert row.verdict in verdicts.KINDS
        assert re.fullmatch(r"[A-Z`].{20,}\.", row.reason), row.reason


def test_a_finding_needs_a_verdict_that_is_not_false(
    mirror: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    head = "\t".join(verdicts.Verdict._fields)
    verdicts.VERDICTS.write_text(head + "\n")
    commit(mirror / "owner+other", {"a.nc": GCODE.replace("M2", "G1 X[") + 100 * " "})
    with (tmp_path / "repositories.tsv").open("a") as rows:
        rows.write("gcode\tknown\towner/other\n")
    run_bench(choose, [str(mirror), "--accept"], monkeypatch)
    assert run_bench(verdicts, [str(mirror)], monkeypatch) == 1
    listed = re.findall(r"without a verdict \| (.*) \|", capsys.readouterr().out)
    assert len(listed) == 1
    assert listed[0].startswith("owner/other | a.nc | 14 | refused |")

    row = listed[0].replace(" | ", "\t")
    verdicts.VERDICTS.write_text(f"{head}\n{row}\ttrue\tThe bracket is never closed.\n")
    assert run_bench(verdicts, [str(mirror)], monkeypatch) == 0
    verdicts.VERDICTS.write_text(f"{head}\n{row}\tfalse\tThe bracket is closed in this line.\n")
    assert run_bench(verdicts, [str(mirror)], monkeypatch) == 1
    gone = row.replace("\t14\t", "\t3\t")
    verdicts.VERDICTS.write_text(f"{head}\n{gone}\ttrue\tThe bracket is never closed.\n")
    capsys.readouterr()
    assert run_bench(verdicts, [str(mirror)], monkeypatch) == 1
    assert "| gone | owner/other | a.nc | 3 |" in capsys.readouterr().out


def test_programs_are_chosen_by_their_text(
    mirror: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_bench(choose, [str(mirror), "--accept"], monkeypatch)
    assert {(entry.language, entry.path) for entry in choose.read_list()} == {
        ("gcode", "made.nc"),
        ("gcode", "short.nc"),
        ("rapid", "sub/made.mod"),
    }
    assert "rapid, new: owner/gone: no git directory in the folder" in capsys.readouterr().out


def test_a_finding_that_changes_is_listed_with_its_lines(
    mirror: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run_bench(choose, [str(mirror), "--accept"], monkeypatch)
    words = [str(mirror), "rapid", "--texts", str(tmp_path / "texts")]
    run_bench(public, [*words, "--accept"], monkeypatch)
    assert run_bench(public, words, monkeypatch) == 0
    (row,) = public.read_findings().values()
    assert "instructions=5" in row.counts  # two motions of main, again by its name, and a wait
    assert "runs=3" in row.counts
    capsys.readouterr()

    monkeypatch.setattr(public, "examine", examine_with_another_wait)
    assert run_bench(public, words, monkeypatch) == 1
    text = capsys.readouterr().out
    assert "owner/name sub/made.mod" in text
    assert "  -8 [0] Wait(seconds=1.50000)" in text
    assert "  +8 [0] Wait(seconds=2.50000)" in text


def examine_with_another_wait(language: str, name: str, data: bytes) -> examine.Examined:
    """The findings of a program that waits for another time."""
    return examine.examine(language, name, data.replace(b"1.5", b"2.5"))


def test_a_program_that_is_gone_is_named_and_fails(
    mirror: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_bench(choose, [str(mirror), "--accept"], monkeypatch)
    run_bench(public, [str(mirror), "--accept"], monkeypatch)
    capsys.readouterr()
    assert run_bench(public, [str(mirror / "none")], monkeypatch) == 1
    assert "owner/name: no git directory in the folder" in capsys.readouterr().out
    with pytest.raises(MissingError, match="cat-file"):
        Mirror(mirror, "owner/name").read_file("HEAD", "none.mod")


def test_a_fault_of_camgen_is_a_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("made")

    monkeypatch.setattr(examine, "find_language", fail)
    examined = examine.examine("rapid", "made.mod", RAPID.encode())
    assert examined.counts["traceback"] == 1
    assert "traceback: ZeroDivisionError: made" in examined.texts


def test_values_are_rounded_and_defaults_left_out() -> None:
    motion = MoveL(Pose(IDENTITY, (1.0000001, -1e-9, 2.0)), 100.0)
    expected = (
        "MoveL(target=Pose(rotation=((1.00000, 0, 0), (0, 1.00000, 0), (0, 0, 1.00000)), "
        "origin=(1.00000, 0, 2.00000)), speed=100.00000)"
    )
    assert examine.format_value(motion) == expected
    assert examine.format_value(Wait(0.25)) == "Wait(seconds=0.25)"


def test_a_verdict_that_changes_is_found() -> None:
    (batch, *_) = plan_batches([Family("grbl", "single", mutants.LIST_SEED)], mutants.LIST_MOST)
    batch = batch._replace(places=batch.places[:4])
    row = mutants.make_row(batch, "cchc")
    assert mutants.unpack(row.verdicts) == "cchc"
    assert mutants.find_changes(batch, "cchc", row) == []
    (change,) = mutants.find_changes(batch, "cclc", row)
    assert f"{batch.list_mutants()[2].kind}: harmless before, left over now" in change
    assert mutants.find_changes(batch, "ch", row, step=2) == []
    for other in (row._replace(digest=""), None):
        (change,) = mutants.find_changes(batch, "cchc", other)
        assert change.endswith("single: the list has other mutants")


def test_a_read_back_that_ends_with_an_error_is_a_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    def is_caught(_posted: PostedProgram, text: str) -> bool:
        if text == first.apply(make("grbl", 0).text):
            return True
        raise ValueError("made")

    (batch, *_) = plan_batches([Family("grbl", "single", mutants.LIST_SEED)], mutants.LIST_MOST)
    batch = batch._replace(places=batch.places[:2])
    first, _ = batch.list_mutants()
    monkeypatch.setattr(PostedProgram, "is_caught", is_caught)
    assert find_verdicts(batch) == "cx"


def test_the_committed_verdicts_are_those_of_the_mutants() -> None:
    rows = mutants.read_rows()
    assert {post for _, post, _ in rows} == {"rapid", "pacscript", "vplus", "gcode", "grbl"}
    for row in rows.values():
        counts = Counter(mutants.unpack(row.verdicts))
        numbers = counts.total(), counts["c"], counts["h"], counts["l"] + counts["x"]
        assert numbers == tuple(map(int, (row.mutants, row.caught, row.harmless, row.left)))
