import pytest

from camgen.localize import localize
from tests.support.remembered import remembered

LOCALIZE = remembered(localize)


@pytest.fixture
def localize_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command locates a part once for the same model, scan, start and viewpoint."""
    monkeypatch.setattr("camgen.cli.localize.localize", LOCALIZE)
