"""YAML without aliases: with them a few hundred bytes stand for gigabytes."""

from typing import Any

import yaml


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader, which refuses *name."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem="aliases (*name) are not allowed here", problem_mark=mark)
        return super().compose_node(parent, index)


def load_document(text: str) -> tuple[yaml.Node | None, Any]:
    """The one document of a text, as node and as value, (None, None) where it is empty.

    yaml.YAMLError where it is none, or a value is absurd.
    """
    loader = _Loader(text)
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
