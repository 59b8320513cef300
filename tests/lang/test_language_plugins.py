"""Languages of other packages: a fault of a language or of its result is an error."""

import importlib
import sys

import pytest

from camgen.lang.programs import LANGUAGES, RunRequest, find_language, list_languages
from camgen.model.errors import JobError

MODULE = """
from camgen.model.program import Wait
from camgen.lang.programs import Assumption, Executed, Finding, Frames, Language

def run(files, ask):
    return {result}

STRANGE = {language}
"""
GOOD = 'Language("strange", "a language", (".str",), lambda text: False, run)'
RESULT = "Executed((Wait(1.0),), (1,))"


def install(tmp_path, monkeypatch, language=GOOD, result=RESULT):
    """Install a package in a separate folder, in which it is found by its metadata."""
    (tmp_path / "strange_language.py").write_text(MODULE.format(language=language, result=result))
    info = tmp_path / "strange-3.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: strange\nVersion: 3.1\n")
    entry = f"[{LANGUAGES}]\nstrange=strange_language:STRANGE\n"
    (info / "entry_points.txt").write_text(entry)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "strange_language", raising=False)
    importlib.invalidate_caches()


def test_a_language_is_found_and_runs(tmp_path, monkeypatch):
    install(tmp_path, monkeypatch)
    assert "strange" in [language.name for language in list_languages()]
    assert find_language("strange").run({"a": ""}, RunRequest()).lines == (1,)


@pytest.mark.parametrize("name", ["gcode", "grbl", "pacscript", "rapid", "vplus"])
def test_the_built_in_languages_have_all_members(name):
    assert find_language(name).name == name


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (GOOD, "None", "the entry point is None, not a Language"),
        ('"strange"', '""', "has name that is '', not a name"),
        ('"a language"', "3", "has about that is 3, not a line of text"),
        ('(".str",)', '".str"', "has suffixes that is '.str', not a tuple"),
        ('(".str",)', '("str",)', "has suffixes that has an element that is 'str'"),
        ('(".str",)', '(".STR",)', "has suffixes that has an element that is '.STR'"),
        ("lambda text: False", "True", "has recognise that is True, not a function"),
        (", run)", ", 3)", "has run that is 3, not a function"),
        (", run)", ", run, 3)", "has dialects that is 3, not a tuple of names"),
        (", run)", ", run, (), ('entri',))", "has takes that has the unknown word 'entri'"),
    ],
)
def test_a_wrong_member_is_named(tmp_path, monkeypatch, old, new, message):
    install(tmp_path, monkeypatch, GOOD.replace(old, new))
    with pytest.raises(JobError) as caught:
        find_language("strange")
    assert str(caught.value).startswith("language strange: ")
    assert message in str(caught.value)
    assert str(caught.value).endswith("; correct or remove its package")
    with pytest.raises(JobError):
        list_languages()


@pytest.mark.parametrize(
    ("result", "message"),
    [
        ("None", "run() is None, not an Executed"),
        ("Executed(('x',), (1,))", "body that has an element of the type str"),
        ("Executed((Wait(1.0),), (1, 2))", "lines that has 2 numbers for 1 instruction"),
        ("Executed((Wait(1.0),), (0,))", "lines that has an element that is not a line number"),
        ("Executed((), 'x')", "lines that is 'x', not a sequence of line numbers"),
        ("Executed((), (), ('tool',))", "frames that has an element that is 'tool'"),
        ("Executed((Wait(1.0),), (1,), (Frames(),), (0, 0))", "2 places of frames for 1 instr"),
        ("Executed((Wait(1.0),), (1,), (Frames(),), (1,))", "a place of a frame that is not there"),
        (
            "Executed((), (), findings=(Finding('odd', 1, 'x'),))",
            "level that is 'odd', not a level",
        ),
        ("Executed((), (), findings=('x',))", "findings that has an element that is 'x'"),
        ("Executed((), (), assumed=(Assumption('1', 'x'),))", "line that is '1', not a whole num"),
        ("Executed((), (), facts='x')", "facts that is 'x', not a tuple"),
        ("Executed((), (), lost=['x'])", "lost that is ['x'], not a tuple"),
    ],
)
def test_a_wrong_result_is_named(tmp_path, monkeypatch, result, message):
    install(tmp_path, monkeypatch, result=result)
    with pytest.raises(JobError) as caught:
        find_language("strange").run({"a": ""}, RunRequest())
    assert message in str(caught.value)
    assert caught.value.exit_code == 2
