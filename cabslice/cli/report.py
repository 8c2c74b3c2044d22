"""What is said and where: the answer to stdout, the talk to stderr, or one JSON object instead of the answer."""

from __future__ import annotations

import io
import json
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TextIO

from cabslice.cli import interrupt

Tick = Callable[[str, int, int], None]   # stage, done, total
Row = Sequence[str]


def _plain(value: Any) -> Any:
    """numpy scalars and arrays, tuples, paths: as JSON can say them."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def print_json(content: Mapping[str, Any]) -> None:
    json.dump(content, sys.stdout, default=_plain)
    sys.stdout.write("\n")
    sys.stdout.flush()


@dataclass(frozen=True)
class Talk:
    """How one command speaks: -v, -q, --json; `aside` where stdout is taken by the product itself (-o -)."""

    json: bool = False
    verbose: bool = False
    quiet: bool = False
    aside: bool = False

    def say(self, text: str) -> None:
        if not self.quiet:
            print(text, file=sys.stderr)

    def detail(self, text: str) -> None:
        if self.verbose:
            print(text, file=sys.stderr)

    def answer(self, content: Mapping[str, Any], *blocks: str | Table) -> None:
        """`content` as JSON, or the same said in `blocks`."""
        out = sys.stderr if self.aside else sys.stdout
        if self.json:
            print_json(content)
        elif not (self.aside and self.quiet):
            for block in filter(None, blocks):
                block.print(out) if isinstance(block, Table) else print(block, file=out)

    @contextmanager
    def progress(self) -> Iterator[Tick]:
        """A bar per stage with time left, on a terminal; else nothing. With -v the seconds of each stage at the end."""
        last: dict[str, float] = {}
        began = time.perf_counter()
        with self._bars() as tick:
            def timed(stage: str, done: int, total: int) -> None:
                interrupt.heed()
                last[stage] = time.perf_counter()
                tick(stage, done, total)

            yield timed
        for stage, ended in last.items():
            self.detail(f"{stage:<6} {ended - began:8.2f} s")
            began = ended

    @contextmanager
    def _bars(self) -> Iterator[Tick]:
        if self.quiet or not sys.stderr.isatty():
            yield lambda stage, done, total: None
            return
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = TextColumn("{task.description:<8}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
        with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
            tasks: dict[str, Any] = {}

            def tick(stage: str, done: int, total: int) -> None:
                if stage not in tasks:
                    tasks[stage] = bars.add_task(stage, total=total)
                bars.update(tasks[stage], completed=done, total=total)

            yield tick


@dataclass(frozen=True)
class Table:
    """Rows of words; columns whose head begins with ">" are numbers, set to the right."""

    head: Row
    rows: Sequence[Row]

    def print(self, out: TextIO) -> None:
        from rich.console import Console
        from rich.table import Table as RichTable

        table = RichTable(box=None, show_header=any(self.head), pad_edge=False, padding=(0, 2, 0, 0))
        for name in self.head:
            justify: Any = "right" if name.startswith(">") else "left"
            table.add_column(name.lstrip(">"), justify=justify, no_wrap=not out.isatty())
        for row in self.rows:
            table.add_row(*row)
        text = io.StringIO()
        width = shutil.get_terminal_size().columns if out.isatty() else 400
        Console(file=text, highlight=False, markup=False, width=width).print(table)
        print(*map(str.rstrip, text.getvalue().splitlines()), sep="\n", file=out)


def clock(seconds: float) -> str:
    """2 h 03 min 04 s"""
    whole = round(seconds)
    hours, minutes = whole // 3600, whole % 3600 // 60
    if hours:
        return f"{hours} h {minutes:02d} min {whole % 60:02d} s"
    return f"{minutes} min {whole % 60:02d} s" if minutes else f"{seconds:.1f} s"
