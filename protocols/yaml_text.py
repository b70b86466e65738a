"""YAML without aliases: with them a few hundred bytes stand for gigabytes."""

from typing import Any

import yaml
from yaml.reader import ReaderError

_LARGEST = 10**300


_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader, which refuses *name, and knows neither base 60 nor octal numbers.

    YAML 1.1 makes 141 of 2:21, which people write for degrees and minutes, and 8 of 010.
    """

    base_60 = False
    """Whether numbers are read by YAML 1.1, as in files that were recorded so."""

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        tag = super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]
        is_refused = tag in _NUMBERS and ":" in str(value) and not self.base_60
        return "tag:yaml.org,2002:str" if is_refused else tag

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem="aliases (*name) are not allowed here", problem_mark=mark)
        return super().compose_node(parent, index)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """The value of a node; yaml.MarkedYAMLError where its tag does not fit, as in ``!!timestamp x``."""
        try:
            return super().construct_object(node, deep)
        except (ValueError, TypeError, OverflowError, AttributeError, LookupError) as error:
            kind = node.tag.rpartition(":")[2]
            problem = f"{node.value!r:.60} is not a value of the kind {kind!r:.40}"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark) from error

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        """A whole number. Of more than 4,300 digits Python refuses to write it down, even in a message."""
        digits = str(node.value).replace("_", "").lstrip("+-")
        if digits.startswith("0") and digits.isdecimal() and not self.base_60:
            node.value = node.value.replace(digits, digits.lstrip("0") or "0")
        value = super().construct_yaml_int(node)
        if abs(value) >= _LARGEST:
            raise yaml.MarkedYAMLError(problem="a number of more than 300 digits", problem_mark=node.start_mark)
        return value


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)


def load_document(text: str, *, base_60: bool = False) -> tuple[yaml.Node | None, Any]:
    """The one document of a text, as node and as value, (None, None) where it is empty.

    With ``base_60`` 2:21 is 141 and 010 is 8, as in YAML 1.1. yaml.YAMLError where it is none, or a value is absurd.
    """
    try:
        loader = _Loader(text)
        loader.base_60 = base_60
    except ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        problem = f"the character U+{ord(text[error.position]):04X} in line {line} is not allowed in YAML"
        raise yaml.MarkedYAMLError(problem=problem) from error
    try:
        root = loader.get_single_node()
        return root, loader.construct_document(root) if root else None
    except RecursionError:
        raise yaml.MarkedYAMLError(problem="nested too deeply") from None
    except (ValueError, TypeError, OverflowError) as error:
        problem = f"a value that is not one: {str(error).splitlines()[0][:80]}"
        raise yaml.MarkedYAMLError(problem=problem) from error
    finally:
        loader.dispose()


def yaml_problem(error: yaml.YAMLError, source: str) -> str:
    """Why the text of ``source`` is no YAML, with the line, in words for who wrote it."""
    mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None) or str(error).splitlines()[0]
    if "\\t" in problem:
        problem += "; indent with blanks, not with tabs"
    elif "<stream end>" in problem or "end of stream" in problem:
        problem = "the text ends in the middle of something: is it cut off, is a bracket or a quote not closed?"
    elif problem.startswith("expected <block end>"):
        problem = "this does not belong here: is it indented as its neighbours, is a quote above it not closed?"
    return f"{source}, line {mark.line + 1}: {problem}" if mark else f"{source}: {problem}"
