"""Small programs in whose text the read-back finds nothing, for tests that change the text."""

from collections.abc import Mapping, Sequence
from functools import cached_property

from camgen.lang.programs import Executed, Finding
from camgen.model.errors import VerifyError
from camgen.model.pose import translation
from camgen.model.program import Instruction, Program
from camgen.post.plugins import fill_tables, find_post, find_readback, make_post
from camgen.post.verify import compare
from tests.support.whole import whole

Options = Mapping[str, object]


class Sample:
    """A program with its text, its post and its read-back.

    source: body of the program, or its text, which then cannot be verified.
    post: the post with its options.
    options: options of the read-back.
    read: the read-back.
    """

    def __init__(
        self,
        post: str,
        source: str | Sequence[Instruction],
        options: Options | None = None,
        readback: str = "",
    ) -> None:
        """`post` and `readback` are names; an empty `readback` has the name of the post."""
        kind = find_post(post)
        self.source = source
        self.post = make_post(kind, options or {})
        self.options = fill_tables(kind, options or {})
        self.read = find_readback(readback or post)

    @cached_property
    def prepared(self) -> Program:
        """The program as the post prints it."""
        frames = (translation(300, -75, 150), translation(0, 0, 100))
        return self.post.prepare(Program("part", *frames, whole(self.source)), 0.01)

    @cached_property
    def written(self) -> str:
        """The text, whether or not the read-back takes it."""
        if isinstance(self.source, str):
            return self.source
        (file,) = self.post.render(self.prepared)
        return file.text

    @cached_property
    def text(self) -> str:
        """The text, in which the read-back finds nothing."""
        assert self.list_faults(self.written) == ()
        return self.written

    def read_back(self, text: str) -> Executed:
        """The reading of a text."""
        return self.read({"part": text}, self.options)

    def list_faults(self, text: str) -> tuple[Finding, ...]:
        """Faults and remarks of a text."""
        return self.read_back(text).findings

    def verify(self, text: str) -> None:
        """Compares a text with the program. Raises VerifyError if they differ."""
        limits = self.post.tolerance()
        compare(self.prepared, self.read_back(text), limits, self.post.list_verified(), "part")

    def is_refused(self, text: str) -> bool:
        """Whether a build would refuse the text."""
        try:
            self.verify(text)
        except VerifyError:
            return True
        return False

    def change(self, before: str, after: str) -> str:
        """The text with `after` instead of the first `before`."""
        assert before in self.text, self.text
        return self.text.replace(before, after, 1)

    def faults_after(self, before: str, after: str) -> list[str]:
        """Words of all faults and remarks of the changed text."""
        return [fault.what for fault in self.list_faults(self.change(before, after))]

    def insert(self, row: int, line: str) -> str:
        """The text with one more line, `row` lines from its start."""
        lines = self.text.splitlines(keepends=True)
        return "".join((*lines[:row], f"{line}\n", *lines[row:]))
