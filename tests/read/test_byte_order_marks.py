"""Programs in UTF-8 may have a byte order mark. Programs in UTF-16 are refused."""

from pathlib import Path

import pytest

import camgen
from camgen.lang.programs import RunRequest, find_language

TEXTS = {
    "rapid": """MODULE m
  ! D\u00fcse
  PROC main()
    MoveAbsJ [[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v200,fine,tool0;
  ENDPROC
ENDMODULE
""",
    "vplus": ".PROGRAM a()\n; D\u00fcse\nMOVES TRANS(350,0,250,0,180,0)\n.END\n",
    "pacscript": "Sub Main\n  ' D\u00fcse\n  TakeArm\n  Move P, @0 P(300, 0, 250)\nEnd Sub\n",
}
SUFFIXES = {"rapid": "mod", "vplus": "v2", "pacscript": "pcs"}


@pytest.mark.parametrize("mark", ["\ufeff", "\xef\xbb\xbf"])
@pytest.mark.parametrize("language", TEXTS)
def test_a_byte_order_mark_of_utf_8_changes_nothing(language: str, mark: str) -> None:
    """The mark is a character, or three characters if the file is read as Latin-1."""
    rules, text = find_language(language), TEXTS[language]
    with_mark = rules.run({"a": mark + text, "b": mark + "\n"}, RunRequest())
    without = rules.run({"a": text, "b": "\n"}, RunRequest())
    assert with_mark.lines == without.lines
    assert with_mark.findings == without.findings
    assert list(map(repr, with_mark.body)) == list(map(repr, without.body))
    assert rules.recognise(mark + text) == rules.recognise(text)


@pytest.mark.parametrize("language", TEXTS)
def test_a_program_in_utf_16_is_refused_in_one_line(tmp_path: Path, language: str) -> None:
    file = tmp_path / f"a.{SUFFIXES[language]}"
    file.write_bytes(TEXTS[language].encode("utf-16"))
    with pytest.raises(camgen.InputError, match="is UTF-16, which no controller reads") as error:
        camgen.build(file, post=language)
    assert "\n" not in str(error.value)
