"""Host of a Python entry point: calls it in a process of its own, a line of JSON in and one out for each panorama.

Run by path, so that nothing of the station is imported. Arguments: object as "module:name", config file or "", sys.path
as JSON, and perhaps --check: then it says what it loaded, as one line of JSON, and ends. The object is called once with
the sensor's description (and config=path where there is a config) and gives the function that answers panoramas. What
it prints goes to stderr.
"""

import importlib
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

Answer = dict[str, Any]


def main() -> int:
    """Check the entry point, or answer panoramas until the input ends."""
    target, config, path, *check = sys.argv[1:]
    sys.path[:] = json.loads(path)
    out = os.dup(1)
    os.dup2(2, 1)
    try:
        make, about = _loaded(target)
    except ModuleNotFoundError as error:
        os.write(out, _line({"error": f"the package {error.name} is not installed; install it beside gse"}))
        return 1
    except Exception as error:  # whatever a foreign module raises while it is imported
        os.write(out, _line({"error": f"{type(error).__name__}: {error}"}))
        return 1
    if check:
        os.write(out, _line(about))
        return 0
    identify = make(json.loads(sys.stdin.buffer.readline()), **({"config": config} if config else {}))
    for line in sys.stdin.buffer:
        os.write(out, _line(_timed(identify, json.loads(line))))
    return 0


def _loaded(target: str) -> tuple[Callable[..., Callable[[Answer], Answer]], dict[str, str]]:
    module_name, _, name = target.partition(":")
    module = importlib.import_module(module_name)
    make: Any = module
    for part in name.split("."):
        make = getattr(make, part)
    if not callable(make):
        raise TypeError(f"{target} is {type(make).__name__}; expected a function of the sensor")
    version = getattr(module, "version", getattr(module, "__version__", ""))
    return make, {"file": str(getattr(module, "program", module.__file__)), "version": str(version)}


def _timed(identify: Callable[[Answer], Answer], panorama: Answer) -> Answer:
    """The answer, with the number of its panorama where it has none and the time of the call."""
    began_ns = time.perf_counter_ns()
    answer = identify(panorama)
    call_us = (time.perf_counter_ns() - began_ns) / 1000
    if not isinstance(answer, dict):
        raise TypeError(f"the answer is {type(answer).__name__}; expected a dict")
    return {"frame_no": panorama["frame_no"], **answer, "call_us": call_us}


def _line(document: Answer) -> bytes:
    return json.dumps(document, separators=(",", ":")).encode() + b"\n"


if __name__ == "__main__":
    sys.exit(main())
