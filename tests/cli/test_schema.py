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


def find_faults(job: dict[str, Any], post: str = "") -> list[str]:
    """The places in a job at which the schema finds a fault."""
    validator = jsonschema.Draft202012Validator(schema(post))
    return [error.json_path for error in validator.iter_errors(job)]


def uncomment_options(text: str, post: str) -> str:
    """The job file of `camgen init` with the commented options of one post as options."""
    head, _, sections = text.partition("[post]")
    groups = sections.split("\n# ")
    options_on, is_of_post = [], False
    for line in groups[1:]:
        if line.rstrip().endswith(":") and " = " not in line:
            is_of_post = line.rstrip() in ("every post:", f"{post}:")
        elif is_of_post:
            options_on.append(line)
    return f"{head}[post]\n" + "\n".join(options_on)


@pytest.mark.parametrize("post", ["", *POSTS])
def test_the_schema_is_valid_and_accepts_a_job_of_init(post: str) -> None:
    jsonschema.Draft202012Validator.check_schema(schema(post))
    job = tomllib.loads(write_template("part.dxf", "mm"))
    assert set(job) == set(list_tables())
    assert find_faults(job, post) == []
    if post:
        full = tomllib.loads(uncomment_options(write_template("part.dxf", "mm"), post))
        assert set(full["post"]) == {
            option.name for option in fields(find_post(post)) if option.init
        }
        assert find_faults(full, post) == []


def test_each_setting_has_its_default_and_its_description() -> None:
    tables = schema()["properties"]
    described: set[tuple[str, str]] = set()
    for name, table in tables.items():
        described |= {(name, key) for key in table.get("properties", {})}
    assert described == {(setting.table, setting.key) for setting in list_settings()}
    for setting in list_settings():
        key = tables[setting.table]["properties"][setting.key]
        assert key["description"] == setting.about
        assert key.get("default") == setting.default
        assert "null" not in json.dumps(key)


#: Settings of a job file that are valid, and settings that are not: table.key and value.
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
def test_the_schema_accepts_the_values_that_camgen_accepts(name: str, value: object) -> None:
    table, key = name.split(".")
    job = {table: {key: value}}
    if (name, value) in GOOD:
        from_mapping(copy.deepcopy(job))
        assert find_faults(job) == []
    else:
        with pytest.raises(JobError):
            from_mapping(copy.deepcopy(job))
        assert len(find_faults(job)) == 1


@pytest.mark.parametrize(
    ("post", "options", "is_valid"),
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
def test_the_schema_accepts_the_options_that_the_post_accepts(
    post: str, options: dict[str, object], is_valid: bool
) -> None:
    assert (find_faults({"post": options}, post) == []) is is_valid
    if post and is_valid:
        make_post(find_post(post), options)
    elif post:
        with pytest.raises(JobError):
            make_post(find_post(post), options)


def test_an_option_of_an_unknown_type_accepts_any_value(monkeypatch: pytest.MonkeyPatch) -> None:
    class Unknown:
        pass

    @dataclass
    class Foreign(find_post("gcode")):  # type: ignore[misc]
        about: ClassVar[str] = "a machine"
        thing: Unknown | None = None

    Foreign.__annotations__ = {"about": ClassVar[str], "thing": Unknown | None}
    monkeypatch.setattr(import_module("camgen.post.job_schema"), "find_post", lambda _: Foreign)
    assert find_faults({"post": {"thing": 5}}, "foreign") == []
    assert find_faults({"post": {"thong": 5}}, "foreign") == ["$.post"]


def test_the_command_prints_the_schema(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["schema", "--post", "rapid"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out) == schema("rapid")
    assert printed.err == ""
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == schema()
    assert main(["schema", "--post", "rapit"]) == 2
    assert capsys.readouterr().err.startswith(
        "camgen: error: post rapit: is not installed; nearest is rapid"
    )
    (tmp_path / "part.nc").write_text("G21\n")
    assert main(["init", "part.nc"]) == 0
    assert find_faults(tomllib.loads((tmp_path / "part.toml").read_text())) == []
