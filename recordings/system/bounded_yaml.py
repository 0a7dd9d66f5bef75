"""YAML from outside: without anchors, tags and deep nesting, and of a limited length.

A few lines of anchors expand to gigabytes, tags make objects, and 200,000 brackets overflow the stack of libyaml, which
ends the process.
"""

from typing import Any

import yaml

LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml, where it is there, reads ten times as fast
MOST_DEEP = 40  # nesting; reading time grows with its square, so a file of 3 kB could take seconds
EDITED = "Check whether it was truncated or edited."
_OPENING = (
    yaml.FlowSequenceStartToken,
    yaml.FlowMappingStartToken,
    yaml.BlockSequenceStartToken,
    yaml.BlockMappingStartToken,
)
_CLOSING = (yaml.FlowSequenceEndToken, yaml.FlowMappingEndToken, yaml.BlockEndToken)


class YamlError(ValueError):
    """A text that is not read, in one sentence; `hint` says what to do."""

    def __init__(self, message: str, hint: str = EDITED) -> None:
        super().__init__(message)
        self.hint = hint


def load(text: str, longest: int) -> Any:
    """The value of a text.

    Args:
        longest: characters.

    Raises:
        YamlError: it is malformed, or exceeds a limit.
    """
    if len(text) > longest:
        raise YamlError("This file is too large.", f"The maximum is {longest} characters.")
    try:
        _check(text)
        return yaml.load(text, Loader=LOADER)
    except YamlError:
        raise
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"Line {mark.line + 1}: " if mark is not None else ""
        problem = getattr(error, "problem", None) or "it is malformed"
        raise YamlError(f"{where}this is not valid YAML: {problem}.") from None
    except (RecursionError, ValueError) as error:
        raise YamlError(f"This is not valid YAML: {error}.") from None


def _check(text: str) -> None:
    deep = 0
    for token in yaml.scan(text, Loader=LOADER):
        line = token.start_mark.line + 1
        if isinstance(token, yaml.ScalarToken) and any("\ud800" <= one <= "\udfff" for one in token.value):
            raise YamlError(f"Line {line} contains an unpaired surrogate.", "Check whether it was edited.")
        deep += isinstance(token, _OPENING) - isinstance(token, _CLOSING)
        if deep > MOST_DEEP:
            raise YamlError(f"Line {line}: nested too deeply.")
        if isinstance(token, yaml.AnchorToken | yaml.AliasToken | yaml.TagToken):
            raise YamlError(f"Line {line}: anchors and tags are not allowed.", "Write the values out.")
