"""Which test files call which functions: a plugin of pytest that records it, and the choice of tests for a changed line.

``python -m pytest -p calls`` with the environment variable CALLS_FILE writes, for each test file, the functions of the folder where
pytest runs that it calls, as ``path:first line``.
"""

import ast
import json
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType

ENVIRONMENT = "CALLS_FILE"


class Recorder:
    """Code objects that each test file calls; calls of imports and fixtures count for the file that runs meanwhile."""

    def __init__(self) -> None:
        self.called: dict[str, set[CodeType]] = {}
        self.current: set[CodeType] = set()

    def trace(self, frame: FrameType, event: str, argument: object) -> None:
        self.current.add(frame.f_code)

    def begin(self, path: Path) -> None:
        self.current = self.called.setdefault(path.relative_to(Path.cwd()).as_posix(), set())

    def written(self) -> dict[str, list[str]]:
        """``path:first line`` of the functions below the folder, by test file."""
        root = str(Path.cwd()) + os.sep
        own = {file: [c for c in codes if c.co_filename.startswith(root)] for file, codes in self.called.items()}
        return {file: sorted({f"{c.co_filename[len(root) :]}:{c.co_firstlineno}" for c in codes}) for file, codes in own.items()}


if ENVIRONMENT in os.environ:
    _recorder = Recorder()

    def pytest_configure(config: object) -> None:
        sys.settrace(_recorder.trace)
        threading.settrace(_recorder.trace)

    def pytest_collectstart(collector) -> None:  # type: ignore[no-untyped-def]
        if collector.path.is_file():
            _recorder.begin(collector.path)

    def pytest_runtest_setup(item) -> None:  # type: ignore[no-untyped-def]
        _recorder.begin(item.path)

    def pytest_unconfigure(config: object) -> None:
        sys.settrace(None)
        Path(os.environ[ENVIRONMENT]).write_text(json.dumps(_recorder.written()))


def callers(called: dict[str, list[str]], path: str, source: bytes, line: int) -> set[str]:
    """Test files that call the function around a line; all where the line runs on import."""
    around = [first for first, begin, end in _functions(ast.parse(source)) if begin <= line <= end]
    return {file for file, places in called.items() if not around or f"{path}:{around[-1]}" in places}


def _functions(tree: ast.AST) -> Iterator[tuple[int, int, int]]:
    """First line with decorators, and first and last line of the body, of every function; inner ones after outer ones."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            yield first, node.body[0].lineno, node.end_lineno or node.lineno
        yield from _functions(node)
