import copy
import json
import tomllib
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import pytest

from camgen.cli import main
from camgen.cli.init import write_template
from camgen.model.errors import JobError
from camgen.model.job_tables import list_settings, list_tables
from camgen.post.job_schema import schema
from camgen.post.plugins import find_post, list_installed, make_post
from camgen.read.job_file import from_mapping

POSTS = [post.name for post in list_installed()]
jsonschema = pytest.importorskip(
    "jsonschema", reason="jsonschema of the extra dev is not installed"
)


def faults(job: dict[str, Any], post: str = "") -> list[str]:
    validator = jsonschema.Draft202012Validator(schema(post))
    return [error.json_path for error in validator.iter_errors(job)]


def with_comments_on(text: str, post: str) -> str:
    """The job file of ``camgen init`` with the options of one post in it instead of beside it."""
    head, _, options = text.partition("[post]")
    groups = options.split("\n# ")
    kept, on = [], False
    for line in groups[1:]:
        if line.rstrip().endswith(":") and " = " not in line:
            on = line.rstrip() in ("every post:", f"{post}:")
        elif on:
            kept.append(line)
    return f"{head}[post]\n" + "\n".join(kept)


@pytest.mark.parametrize("post", ["", *POSTS])
def test_is_a_schema_and_takes_what_init_writes(post: str) -> None:
    jsonschema.Draft202012Validator.check_schema(schema(post))
    job = tomllib.loads(write_template("part.dxf", "mm"))
    assert set(job) == set(list_tables())
    assert faults(job, post) == []
    if post:
        full = tomllib.loads(with_comments_on(write_template("part.dxf", "mm"), post))
        assert set(full["post"]) == {
            option.name for option in fields(find_post(post)) if option.init
        }
        assert faults(full, post) == []


def test_every_setting_is_in_it_with_its_default_and_its_sentence() -> None:
    found = schema()["properties"]
    told = {(table, key) for table in found for key in found[table].get("properties", {})}
    assert told == {(s.table, s.key) for s in list_settings()}
    for s in list_settings():
        key = found[s.table]["properties"][s.key]
        assert key["description"] == s.about
        assert key.get("default") == s.default
        assert "null" not in json.dumps(key)


#: What a job file may hold and what not, as table.key = value.
GOOD = [
    ("tool.diameter", 4),
    ("image.threshold", 12.5),
    ("operation.kind", "trace"),
    ("page.size", "A4"),
    ("page.size", [200, 100]),
    ("page.scale", 0.5),
    ("page.scale", "fit"),
    ("cell.fixtures", [[0, 0, 0, 1, 1, 1], "clamp.stl"]),
    ("input.layers", ["a*", "!b"]),
]
BAD = [
    ("tool.diameter", 0),
    ("tool.diameter", "four"),
    ("tool.diametre", 4),
    ("image.threshold", 256),
    ("operation.kind", "mill"),
    ("operation.passes", 0),
    ("operation.passes", 1.5),
    ("page.scale", "true size"),
    ("cell.fixtures", [5]),
    ("tools.diameter", 4),
]


@pytest.mark.parametrize(("name", "value"), GOOD + BAD)
def test_says_the_same_as_camgen(name: str, value: object) -> None:
    table, key = name.split(".")
    job = {table: {key: value}}
    if (name, value) in GOOD:
        from_mapping(copy.deepcopy(job))
        assert faults(job) == []
    else:
        with pytest.raises(JobError):
            from_mapping(copy.deepcopy(job))
        assert len(faults(job)) == 1


@pytest.mark.parametrize(
    ("post", "options", "good"),
    [
        ("rapid", {"decimals": 2}, True),
        ("rapid", {"decimals": "two"}, False),
        ("rapid", {"pass_mark": "P"}, False),
        ("pacscript", {"pass_mark": "mm"}, True),
        ("pacscript", {"pass_mark": "cm"}, False),
        ("pacscript", {"signals": {"process": 3}}, True),
        ("pacscript", {"signals": {"process": "three"}}, False),
        ("", {"anything": 1}, True),
    ],
)
def test_options_of_a_post(post: str, options: dict[str, object], good: bool) -> None:
    assert (faults({"post": options}, post) == []) is good
    if post and good:
        make_post(find_post(post), options)
    elif post:
        with pytest.raises(JobError):
            make_post(find_post(post), options)


def test_a_post_with_an_option_that_no_schema_can_say(monkeypatch: pytest.MonkeyPatch) -> None:
    class Own:
        pass

    @dataclass
    class Foreign(find_post("gcode")):  # type: ignore[misc]
        about: ClassVar[str] = "a machine"
        thing: Own | None = None

    Foreign.__annotations__ = {"about": ClassVar[str], "thing": Own | None}
    monkeypatch.setattr(import_module("camgen.post.job_schema"), "find_post", lambda _: Foreign)
    assert faults({"post": {"thing": 5}}, "foreign") == []
    assert faults({"post": {"thong": 5}}, "foreign") == ["$.post"]


def test_command(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["schema", "--post", "rapid"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == schema("rapid")
    assert said.err == ""
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == schema()
    assert main(["schema", "--post", "rapit"]) == 2
    assert capsys.readouterr().err.startswith(
        "camgen: error: post rapit: is not installed; nearest is rapid"
    )
    (tmp_path / "part.nc").write_text("G21\n")
    assert main(["init", "part.nc"]) == 0
    assert faults(tomllib.loads((tmp_path / "part.toml").read_text())) == []
