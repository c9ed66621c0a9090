"""``scenetrace seal``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import OutputExistsError, UsageError
from replay.cli import common
from replay.cli.exit_codes import Exit

if TYPE_CHECKING:
    from replay.sealing.manifest import Manifest


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "seal",
        "a manifest of digests over a case's files",
        "Write a manifest with the SHA-256 of every file of a case: source, scene log,"
        " annotated log, exports.\n`scenetrace verify --manifest` names what was altered or"
        " is missing. With a key, the manifest is signed.\nA case (case.toml, see docs/desk.md)"
        " stands for all files that it names, its examiner, date and note.",
        "scenetrace seal video.avi scene.mcap annotated.mcap answers.csv -o case.json\n"
        "scenetrace seal --new-key lab.key\n"
        "scenetrace seal scene.mcap annotated.mcap -o case.json --key lab.key",
    )
    parser.add_argument(
        "files",
        nargs="*",
        type=Path,
        metavar="FILE",
        help="the case's files; a folder means all in it",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="the manifest")
    parser.add_argument(
        "--note", default="", metavar="TEXT", help="a text that is sealed with the files"
    )
    parser.add_argument(
        "--examiner", default="", metavar="NAME", help="who seals; a case says it itself"
    )
    parser.add_argument(
        "--date", default="", metavar="DATE", help="when, as a text; no clock is asked"
    )
    parser.add_argument(
        "--key", type=Path, metavar="FILE", help="sign with this private key (Ed25519, PEM)"
    )
    parser.add_argument(
        "--new-key", type=Path, metavar="FILE", help="make a key pair: FILE and FILE.pub"
    )
    parser.add_argument(
        "--force", action="store_true", help="overwrite an existing manifest"
    )
    common.add_limits(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Seal."""
    from replay.sealing import new_key, sign
    from replay.sealing.manifest import manifests_beside, private_keys, write_manifest

    if args.new_key is None and not args.files:
        raise UsageError(
            "nothing to seal: give the case's files, or --new-key FILE to make a key"
        )
    if args.files and args.output is None:
        raise UsageError("no output: give -o MANIFEST.json")
    if args.files and args.output.exists() and not args.force:
        raise OutputExistsError(args.output)
    key = args.key
    if args.new_key is not None:
        public = new_key(args.new_key)
        key = key or args.new_key
        common.say(
            f"{args.new_key}: the private key, keep it; {public}: the public key, hand"
            " it out"
        )
    if args.files:
        manifest = _sealed(args)
        if key is not None:
            manifest = sign(manifest, key)
        write_manifest(manifest, args.output, force=args.force)
        for other in manifests_beside(args.files, args.output):
            common.say(
                f"{other}: another manifest, not sealed with the folder; name it to seal"
                " it too"
            )
        for name in private_keys(manifest, args.output.parent):
            common.say(
                f"{name}: is a private key: whoever gets the case can sign in its owner's"
                " name; keep it elsewhere"
            )
        for entry in manifest.files:
            print(common.printable(f"{entry.sha256}  {entry.role:<9}  {entry.name}"))
        common.say(
            f"{args.output}: {len(manifest.files)} files"
            + (", signed" if manifest.signature else "")
        )
    return Exit.DONE


def _sealed(args: argparse.Namespace) -> Manifest:
    """The manifest of the files given; a case stands for what it names."""
    from replay.cases import is_case, read_case
    from replay.cases.case_file import not_applied
    from replay.sealing import seal

    files: list[Path] = []
    note, examiner, date = args.note, args.examiner, args.date
    for path in args.files:
        files.append(path)
        if not is_case(path):
            continue
        case = read_case(path)
        for line in not_applied(path, case):
            common.say(f"{path}: {line}")
        named = [path.parent / name for name in case.all_files()]
        files += [file for file in named if file.exists()]
        note = note or ": ".join(t for t in (case.title, case.note) if t)
        examiner, date = examiner or case.examiner, date or case.day
    limits = common.parse_limits(args.limit)
    return seal(files, args.output, note=note, examiner=examiner, date=date, limits=limits)
