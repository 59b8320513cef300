"""Advice that several rooms give, and that `camgen place` does not give about its own result."""

import re

#: What may help where neither roll nor tilt does.
ANOTHER_PLACE = "another place (camgen place)"
_PLACE = re.escape(ANOTHER_PLACE)
_ADVICE = re.compile(rf": {_PLACE} may(?=;|$)|{_PLACE}, | or {_PLACE}")


def drop_place(text: str) -> str:
    """`text` without the advice to run `camgen place`."""
    return _ADVICE.sub("", text)
