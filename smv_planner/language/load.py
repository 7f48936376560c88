"""Where scenarios come from: a file or a folder, a text, or Python values."""

from __future__ import annotations

import os
import stat

from smv_planner.errors import Mistake, ModelError, Place, UsageError
from smv_planner.language.build import model_of
from smv_planner.language.document import Scenario
from smv_planner.language.expand import expand
from smv_planner.language.reader import Report, node_of, read, shorten
from smv_planner.language.shapes import shape_of
from smv_planner.language.strict_yaml import MAX_BYTES, Broken, Mapping, Node, Scalar, Source, parse, place
from smv_planner.model.model import Model

FORMAT = "1"


def load(path: str | os.PathLike[str]) -> Model:
    """The scenario in a file, or in the `model.yaml` of a folder. A path that leads nowhere is a UsageError."""
    file = os.fspath(path)
    try:
        if os.path.isdir(file):
            folder, file = file, os.path.join(file, "model.yaml")
            if not os.path.exists(file):
                raise UsageError([Mistake(f"the folder '{folder}' holds no model.yaml", file=file)])
        if not stat.S_ISREG(os.stat(file).st_mode):
            raise UsageError([Mistake(f"'{file}' is neither a file nor a folder", file=file)])
        with open(file, "rb") as opened:
            data = opened.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise UsageError([Mistake(f"there is no file or folder '{file}'", file=file)]) from None
    except (OSError, ValueError) as error:
        raise UsageError([Mistake(f"'{file}' cannot be read: {getattr(error, 'strerror', None) or error}", file=file)]) from None
    if len(data) > MAX_BYTES:
        raise ModelError([Mistake(f"the file is larger than {MAX_BYTES} bytes", None, Place(file, 1, 1))])
    try:
        return loads(data.decode("utf-8-sig"), file)
    except UnicodeDecodeError as error:
        before = data[: error.start].decode(errors="replace").splitlines() or [""]
        where = Place(file, len(before), len(before[-1]) + 1)
        raise ModelError([Mistake("the text is not UTF-8 here", "save the file as UTF-8", where)]) from None


def loads(text: str, file: str = "<text>") -> Model:
    """The scenario in a text; `file` names it in messages."""
    root, mistakes = parse(Source(file, text.removeprefix("\ufeff")))
    if root is None:
        raise ModelError(mistakes)
    report = Report(mistakes)
    return _model(expand(_of_our_format(root, mistakes), report), report)


def build(scenario: Scenario) -> Model:
    """The scenario that Python values describe."""
    return _model(node_of(scenario), Report([]))


def _model(root: Node, report: Report) -> Model:
    return model_of(read(root, shape_of(Scenario), (), report), report)


def _of_our_format(root: Node, mistakes: list[Mistake]) -> Node:
    """The root, if it says that it is a scenario of this format: of another format, nothing else can be judged."""
    hint = f"a scenario starts with 'smv_planner: {FORMAT}'"
    if not isinstance(root, Mapping):
        raise ModelError([Mistake("this is not a scenario", hint, place(root)), *mistakes])
    version = next((value for key, value in root.entries if key.text == "smv_planner"), None)
    if version is None:
        where = place(root.entries[0][0]) if root.entries else place(root)
        raise ModelError([Mistake("the key 'smv_planner', the version of the format, is missing", hint, where), *mistakes])
    if isinstance(version, Broken):
        raise ModelError(mistakes)
    if not isinstance(version, Scalar) or version.text != FORMAT or not version.plain:
        found = f"'{shorten(version.text)}'" if isinstance(version, Scalar) else "this"
        message = f"{found} is not a version of the format that this program reads"
        raise ModelError([Mistake(message, f"it reads 'smv_planner: {FORMAT}'", place(version))])
    return root
