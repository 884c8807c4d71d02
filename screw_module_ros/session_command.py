# SPDX-License-Identifier: Apache-2.0
"""`session`: show, verify and recover recorded bags; without ROS.

The entry points of `GROUP` add further commands: of this package `therapy.cli`, which evaluates
therapy sessions. Where a package is missing that they need, theirs alone are not there.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
from importlib.metadata import entry_points
from pathlib import Path
from typing import NoReturn

from .programs import missing
from .recording.bag import BagError
from .recording.decoded import calibrations
from .recording.recover import recover
from .recording.verify import Report, verify

GROUP = "screw_module_ros.session"
"""Entry points: functions that add commands to what `add_subparsers` of `session` returned."""


class _Parser(argparse.ArgumentParser):
    """Says to an unknown command which others are not there, and why."""

    lacking = ""

    def error(self, message: str) -> NoReturn:
        super().error(f"{message}{self.lacking}")


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return 0 when all is well, 1 when the bag is not, 2 on wrong usage.

    1 also for what else can go wrong, which is said in one sentence.
    """
    options = _parser().parse_args(arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a name may have unprintable characters
    try:
        code = options.run(options)
        sys.stdout.flush()
    except BrokenPipeError:  # `session info BAG | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (BagError, OSError, ValueError) as error:  # what can go wrong, as of every command
        print(f"session: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return code


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="session", description="Show, verify, recover and evaluate recordings.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, run, text in (
        ("info", _info, "topics, counts and the recorder's notes"),
        ("verify", _verify, "recount every message: complete, or what is missing and where"),
        (
            "recover",
            _recover,
            "copy what can be read of a bag, unfinished or damaged, into the new NAME_recovered; "
            "exit code 1 if the bag states more messages than can be read",
        ),
    ):
        command = commands.add_parser(name, help=text, description=text)
        command.add_argument("bag", type=Path, help="folder of the bag, or its file")
        command.set_defaults(run=run)
        if run is _recover:
            text = "folder for NAME_recovered, by default the one that the bag is in"
            command.add_argument("--out", type=Path, help=text, metavar="FOLDER")
    for point in entry_points(group=GROUP):
        try:
            point.load()(commands)
        except ImportError as error:
            if not (sentence := missing(error)):
                raise
            parser.lacking += f"; without the commands of {point.name}: {sentence}"
    parser.epilog = parser.lacking.removeprefix("; ") or None
    return parser


def _info(options: argparse.Namespace) -> int:
    report = verify(options.bag)
    _print_topics(report)
    print(f"duration: {report.duration:.1f} s")
    try:
        named = calibrations(options.bag)
    except BagError:  # unfinished or damaged, as `verify` says
        named = {}
    for name, values in {"calibration": named, **report.notes}.items():
        print(f"{name}:")
        for key, value in values.items():
            print(f"  {key}: {value}")
    return 0


def _verify(options: argparse.Namespace) -> int:
    report = verify(options.bag)
    _print_topics(report)
    for remark in report.remarks:
        print(f"NOTE {remark}")
    for problem in report.problems:
        print(f"PROBLEM {problem}")
    for name, gaps in report.gaps.items():
        for gap in gaps:
            print(f"  {name}: {gap.missing} missing after {gap.log_time} ns")
    print(report.verdict)
    return 0 if report.complete else 1


def _recover(options: argparse.Namespace) -> int:
    found = recover(options.bag, options.out)
    print(*(f"PROBLEM {problem}" for problem in found.problems),
          f"{found.folder}: {found.messages} messages", sep="\n")  # fmt: skip
    return 1 if found.missing else 0


def _print_topics(report: Report) -> None:
    width = max((len(name) for name in report.topics), default=5)
    print(
        f"{'topic':{width}} {'messages':>9} {'stride':>6} {'lost':>6} {'missed':>6} "
        f"{'dropped':>7} {'double':>6} {'disorder':>8}"
    )
    for name, count in report.topics.items():
        missed = count.missed if count.missed >= 0 else "?"
        print(
            f"{name:{width}} {count.messages:9} {count.stride or '-':>6} {count.lost:6} "
            f"{missed:>6} {count.dropped:7} {count.duplicates:6} {count.out_of_order:8}"
        )
