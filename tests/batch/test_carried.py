"""The files of a job that are sent to a cluster with its part."""

from camgen.batch.perform import list_carried
from camgen.read.job_file import from_mapping


def test_the_settings_of_a_machine_are_sent() -> None:
    assert list_carried(from_mapping({"cell": {"machine": "router.txt"}})) == ["router.txt"]
    assert list_carried(from_mapping({})) == []
