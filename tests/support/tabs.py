"""A page of the workbench in a real browser, driven as a user drives it."""

from typing import Any

from tests.support.benches import Bench
from tests.support.browsers import SIZE, Driven, PageLog, open_context

#: ms between two tests of a condition. A test at each frame makes the browser draw all the time.
POLL = 20


class Tab:
    """A page of the workbench in a browser, and its log.

    draws: whether the pages of its builds draw their scenes
    """

    def __init__(
        self, browser: Driven, bench: Bench, size: dict[str, int] = SIZE, draws: bool = False
    ) -> None:
        self.bench = bench
        self.context = open_context(browser, draws, viewport=size, reduced_motion="reduce")
        self.page = self.context.new_page()
        self.log = PageLog(self.page)
        self.page.goto(bench.address)
        self.rest()

    def rest(self, condition: str = "true") -> dict[str, Any]:
        """The state, called s, when no build runs and `condition` holds."""
        self.page.wait_for_function(
            "() => { const s = window.workbench?.state(); "
            f"return s && !s.stage && (s.built || s.failed) && ({condition}); }}",
            polling=POLL,
        )
        state: dict[str, Any] = self.page.evaluate("workbench.state()")
        return state

    def shown(self, number: int) -> Any:
        """The frame with the page of this build, when it is the visible one."""
        seen = f"#frames iframe:not(.coming)[src='page/{number}']"
        self.page.wait_for_selector(seen)
        frame = self.page.query_selector(seen).content_frame()
        frame.wait_for_function("() => window.camgen !== undefined", polling=POLL)
        return frame

    def field(self, path: str) -> Any:
        """The field of a setting such as process.feed."""
        table, key = path.split(".")
        self.page.locator(f"details[data-table={table}]").evaluate("e => { e.open = true; }")
        return self.page.locator(f"#f-{table}-{key}")

    def enter(self, path: str, text: str) -> None:
        """Types a text into the field of a setting and applies it."""
        field = self.field(path)
        field.fill(text)
        field.press("Enter")

    def open(self, name: str) -> None:
        """Opens a pane of the form: settings, steps, layers, summary or file."""
        self.page.locator(f"aside [data-tab={name}]").click()
