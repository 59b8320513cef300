"""The page of all messages: its content, and messages that state one thing in two ways."""

import ast
import re
from collections import defaultdict

import pytest

from docs.make.messages import GAP, Message, _list_in, list_messages

MODULE = """
_REMEDY = "save it again"


def check(name, size, colors):
    what = f"has {counted(size, 'pixel')}"
    if colors:
        what += ", all of them grey"
    raise InputError(name, what, remedy=_REMEDY)


def look(job, log):
    kind = "warning" if job else "assumed"
    yield Note(kind, f"the scale is {job.scale} mm", "give image.width")
    log.find("refused", "no speed before the motion")
    raise JobError("job", f"{name}")


def test(job, depth):
    check_rules([(depth < 0, "a depth goes down", "operation.depth", "leave out the sign")])
"""


def test_a_text_is_followed_through_variables() -> None:
    messages = set(_list_in(ast.parse(MODULE), is_language=True))
    of_input = "exit code 2: the input"
    scale = f"the scale is {GAP} mm"
    assert messages == {
        Message(of_input, f"has {GAP} pixels", "", "save it again"),
        Message(of_input, f"has {GAP} pixels, all of them grey", "", "save it again"),
        Message("summary: warning", scale, "give image.width", ""),
        Message("summary: assumed", scale, "give image.width", ""),
        Message("finding: refused", "no speed before the motion", "", ""),
        Message(
            "exit code 2: the job or the command", "a depth goes down", "", "leave out the sign"
        ),
    }


def test_names_that_only_languages_use_are_not_messages_elsewhere() -> None:
    messages = _list_in(ast.parse(MODULE), is_language=False)
    assert not [message for message in messages if message.section.startswith("finding")]


@pytest.mark.parametrize(
    "text",
    [
        "is not a text",
        "there is no program to save: …",
        "no layer fits …",
    ],
)
def test_known_messages_are_listed(text: str) -> None:
    assert any(message.text == text for message in list_messages())


#: Two messages with this number of heavy words or fewer may mean different things.
FEW_WORDS = 2
#: Messages of two languages: the wait is an instruction of V+ and a clause of PacScript.
OF_TWO_LANGUAGES = {f"{GAP} the wait for it is over at once", f"wait for {GAP} is over at once"}
#: Words that may differ between two messages of one meaning.
LIGHT = {"a", "an", "the", "is", "are", "of", "in", "to", "it", "its", "that", "this", "and", "or"}


def test_no_two_messages_differ_in_light_words_only() -> None:
    alike: dict[tuple[str, ...], set[str]] = defaultdict(set)
    for message in list_messages():
        words = re.findall(rf"[a-z0-9]+|{GAP}", message.text.lower())
        heavy = tuple(sorted(word for word in words if word not in LIGHT))
        if len(heavy) - heavy.count(GAP) <= FEW_WORDS:
            continue
        alike[heavy].add(re.sub(r"\bare\b", "is", " ".join(words)))
    double = [texts for texts in alike.values() if len(texts) > 1]
    assert [sorted(texts) for texts in double if texts != OF_TWO_LANGUAGES] == []
